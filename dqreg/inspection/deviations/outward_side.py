"""Which side of a target is outside: why it has none, and its mesh with faces that look there."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._records import made_once
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh


def wound_outward(mesh: Mesh) -> Mesh:
    """The mesh, or the same with every face turned round where it is closed and wound inward: normals are outward.

    Faces keep their order. Found once a mesh, which keeps it.
    """
    if why_unsigned(mesh) is not None or not mesh.inward_bodies[0]:
        return mesh
    return made_once(mesh, "_wound_outward", lambda: _turned_round(mesh))


def _turned_round(mesh: Mesh) -> Mesh:
    faces, flat = (np.ascontiguousarray(each[:, ::-1]) for each in (mesh.faces, mesh.flat))
    return dataclasses.replace(mesh, faces=faces, flat=flat)


def outside_of(geometry: Mesh | PointCloud) -> float:
    """Side of the faces of a mesh that is outside."""
    return -1.0 if isinstance(geometry, Mesh) and geometry.inward_bodies[0] else 1.0


def why_unsigned(geometry: Mesh | PointCloud) -> str | None:
    """Why a target has no inside and outside that deviations could tell apart; None where it has.

    Parameters
    ----------
    geometry : Mesh or PointCloud
        The target.

    Returns
    -------
    str or None
        A sentence.

    Examples
    --------
    >>> why_unsigned(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    'the mesh is not watertight (3 sides of faces are open): deviations have no sign'
    """
    if isinstance(geometry, PointCloud):
        if geometry.normals is None:
            return "the target is a cloud without normals: deviations have no sign"
        return None
    if not geometry.is_closed:
        open_sides = geometry.topology.open_sides
        return f"the mesh is not watertight ({open_sides} sides of faces are open): deviations have no sign"
    if not geometry.is_consistently_wound:
        uneven = geometry.topology.uneven_sides
        return (
            f"the mesh has flipped faces ({uneven} sides join faces wound against each other): deviations have no sign"
        )
    inward, bodies = geometry.inward_bodies
    if 0 < inward < bodies:
        return f"{inward} of the mesh's {bodies} bodies are wound inward: deviations have no sign"
    return None


def side_words(geometry: Mesh | PointCloud) -> str:
    """What the sign of deviations means, in words."""
    if isinstance(geometry, Mesh) and geometry.inward_bodies[0]:
        return "positive outside the part; the mesh is wound inward, so its sides were exchanged"
    return "positive outside the part" if isinstance(geometry, Mesh) else "positive on the side of the normals"


def require_sides(geometry: Mesh | PointCloud, what: str) -> None:
    """`InputError` where a target has no inside and outside that something asks for, which is told in the plural."""
    reason = why_unsigned(geometry)
    if reason is not None:
        raise InputError(f"{what} need signs: {reason}; close the mesh, or treat both sides alike")
