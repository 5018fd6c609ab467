"""Signed deviations of a scan from its target: how far each point lies off, and on which side."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from dqreg._arrays import FloatArray, IntArray, as_float, as_place, as_vectors
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_faces import areas_of, faces_of
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.spacing import measure_spacing
from dqreg.geometry.surface import Surface
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.facing_sides import Facing
from dqreg.inspection.deviations.outward_side import outside_of, side_words, why_unsigned
from dqreg.inspection.deviations.signed_distances import Progress, moved, signed_distances
from dqreg.inspection.deviations.wall_doubts import WallDoubt, some_rows, wall_doubts
from dqreg.inspection.membership.membership import EXCLUDED, ON_PART, Flags, Membership, by_reach, in_boxes, membership
from dqreg.inspection.membership.scan_scene import Nominal
from dqreg.inspection.statistics import MIN_PLACE_POINTS, MIN_SCANNED_POINTS
from dqreg.rigid import pose

# Distance between two worst places, in sizes of the target, where the scan's spacing asks for no more.
PLACES_APART_DIAGONALS = 0.05


def measure_deviations(
    points: FloatArray,
    geometry: Mesh | PointCloud,
    surface: Surface,
    *,
    origin: FloatArray | None = None,
    tolerance: float | None = None,
    reach: float | None = None,
    limit: float = math.inf,
    units: str | None = None,
    spacing: float | None = None,
    noise: float | None = None,
    covariance: FloatArray | None = None,
    centre: FloatArray | None = None,
    exclude: Sequence[Sequence[float]] = (),
    progress: Progress | None = None,
    copy: bool = True,
    facing: Facing | None = None,
) -> Deviations:
    """Deviation of every point from a target.

    On a mesh: the distance from the closest point of its triangles, with the side by angle-weighted pseudo-normals
    (see `PseudoNormals`). On a cloud: the distance from a disc in the tangent plane of the nearest point, so that the
    gaps between the points of the target count for nothing; the side by the normals given with the cloud.

    Parameters
    ----------
    points : ndarray, (n, 3)
        The scan under its pose, in the frame of ``geometry``, n >= 1.
    geometry : Mesh or PointCloud
        The target, near the origin.
    surface : Surface
        The same target as a surface.
    origin : ndarray, (3,), optional
        What is added to positions that are handed back: where the target stands in the caller's frame.
    tolerance : float, optional
        Largest deviation allowed, for what is asked of the record later.
    reach : float, optional
        Points farther off are measured, but belong to something else and do not enter the statistics. Default: from
        the points, where ``noise`` is given: as far as surfaces go that continue the part; else ``limit``.
    limit : float
        Where no reach is given, surfaces that run on beyond this distance are the part's only where they continue it
        or replace one of its faces.
    units : str, optional
        Length unit, for words.
    spacing : float, optional
        Spacing of the scan; measured where not given.
    noise : float, optional
        Standard deviation of the scan's noise; with it, surfaces that leave the target and outliers are told from it,
        see `membership`. Without it, reach alone decides.
    covariance, centre : ndarray, (6, 6) and (3,), optional
        Of the pose, rotation vector first, about a point of the caller's frame.
    exclude : sequence of six numbers
        Boxes in the caller's frame whose points are left out of the figures: two opposite corners each.
    progress : callable, optional
        Called with the points done and all points, now and then.
    copy : bool
        Whether the points are left as they are; else their array becomes the record's, in the caller's frame.
    facing : Facing, optional
        Which way the surface looks at each point, where that is known: on a closed mesh a point is of a face that looks
        there, nearer than the reach or the limit. Else the nearest is taken, and `Deviations.wall_doubts` names where
        it may be the wrong side of a thin wall.

    Returns
    -------
    Deviations
        In the order of ``points``.

    Raises
    ------
    InputError
        If there are no points, one is not finite, an array has a wrong shape, tolerance or reach is no length above 0,
        or a box to exclude not six coordinates.

    Examples
    --------
    >>> from dqreg.geometry import MeshSurface
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> measure_deviations(np.array([[0.0, 0, 1.5], [0, 0, 0.75]]), part, MeshSurface(part)).values.tolist()
    [0.5, -0.25]
    """
    # A search for what is closest to NaN finds no end.
    checked = as_vectors(points, "points")
    points = points if checked.base is points else checked
    if not len(points):
        raise InputError("points are empty; deviations are of one point at least")
    reason, count = why_unsigned(geometry), len(points)
    farthest = limit if reach is None else reach
    facing = _that_holds(facing, points, geometry, surface, reason is None)
    values, closest, faces = signed_distances(points, geometry, surface, reason is None, progress, facing, farthest)
    spacing = _spacing_of(points) if spacing is None else spacing
    # A cell of the places must hold enough points; where a probe took them by hand, one is enough.
    resolved = (MIN_PLACE_POINTS if count >= MIN_SCANNED_POINTS else 0.5) * spacing
    shift = np.zeros(3) if origin is None else as_place(origin, "origin")
    given = reach is not None or not math.isfinite(limit)
    if noise is not None and count >= MIN_SCANNED_POINTS:
        nominal = _nominal(geometry, closest, faces)
        found = membership(points, values, nominal, limit=farthest, noise=noise, spacing=spacing, given=given)
    else:
        found = Membership(by_reach(values, farthest), farthest, "given" if given else "size")
    flags = found.flags
    if len(exclude):
        flags[in_boxes(points + shift, exclude)] = EXCLUDED
    return Deviations(
        values=values,
        wall_doubts=_wall_doubts(points, closest, faces, flags, surface, farthest, shift) if facing is None else (),
        points=moved(points, shift, np.zeros(points.shape) if copy else points),
        closest=moved(closest, shift, closest),
        faces=faces,
        signed=reason is None,
        reason=reason or side_words(geometry),
        units=units,
        tolerance=tolerance,
        reach=found.reach,
        reach_from=found.source,
        limit=farthest,
        apart=max(PLACES_APART_DIAGONALS * surface.diagonal, resolved),
        size=surface.diagonal,
        origin=shift,
        flags=flags,
        target=geometry,
        covariance=np.zeros((6, 6)) if covariance is None else _pose_covariance(covariance),
        centre=shift if centre is None else as_place(centre, "centre"),
        noise=noise,
    )


def _pose_covariance(value: FloatArray) -> FloatArray:
    """Covariance of a pose, (6, 6); NaN where it is not known."""
    covariance = as_float(value, "covariance")
    if covariance.shape != (6, 6):
        raise InputError(f"covariance must have shape (6, 6), the rotation first; got shape {covariance.shape}")
    return covariance


def _spacing_of(points: FloatArray) -> float:
    return measure_spacing(NeighbourTree(points), points) if np.ptp(points, axis=0).any() else 0.0


def _that_holds(
    facing: Facing | None, points: FloatArray, geometry: Mesh | PointCloud, surface: Surface, signed: bool
) -> Facing | None:
    """Which way the scan looks, where its target has sides and most of the scan agrees with them."""
    if facing is None or not signed or not isinstance(geometry, Mesh):
        return None
    return facing if facing.holds(points, surface, outside_of(geometry)) else None


def _wall_doubts(
    points: FloatArray,
    feet: FloatArray,
    faces: IntArray,
    flags: Flags,
    surface: Surface,
    limit: float,
    shift: FloatArray,
) -> tuple[WallDoubt, ...]:
    """Patches of the points on a closed mesh that may be of the other side of a thin wall, in the caller's frame."""
    if not isinstance(surface, MeshSurface) or why_unsigned(surface.mesh) is not None:
        return ()
    on = np.flatnonzero(flags == ON_PART)
    rows = on[some_rows(len(on))]
    found = wall_doubts(points[rows], feet[rows], surface.mesh.face_normals[faces[rows]], surface, limit)
    return tuple(dataclasses.replace(each, position=each.position + shift) for each in found)


def _nominal(geometry: Mesh | PointCloud, closest: FloatArray, elements: IntArray) -> Nominal:
    """The target as points see it that are closest to some of its faces or points."""

    def normals(rows: IntArray) -> FloatArray:
        every = geometry.face_normals if isinstance(geometry, Mesh) else geometry.normals
        return np.zeros((len(rows), 3)) if every is None else every[elements[rows]]

    @cache
    def areas() -> FloatArray:
        return areas_of(geometry, faces_of(geometry)[1]) if isinstance(geometry, Mesh) else np.array([math.inf])

    def faces(rows: IntArray) -> IntArray:
        if not isinstance(geometry, Mesh):
            return np.zeros(len(rows), dtype=np.int64)
        return faces_of(geometry)[1][elements[rows]]

    def area(number: int) -> float:
        return float(areas()[number])

    return Nominal(closest, normals, faces, area, geometry.vertices if isinstance(geometry, Mesh) else geometry.points)


def deviations_under(deviations: Deviations, T: FloatArray, covariance: FloatArray, centre: FloatArray) -> Deviations:
    """The same scan under a further alignment, which is as uncertain as told; what belongs to the part stays so.

    ``T`` moves the scan in the caller's target frame; the covariance is about ``centre``, of that frame too.
    """
    mesh = deviations.target
    assert isinstance(mesh, Mesh)
    points = pose.apply(T, deviations.points) - deviations.origin
    # A point stays on its side of a thin wall.
    before = Facing.as_before(lambda rows: outside_of(mesh) * deviations.normals(rows))
    asked = points, mesh, MeshSurface(mesh), why_unsigned(mesh) is None
    values, closest, faces = signed_distances(*asked, facing=before)
    reach = deviations.reach
    if deviations.reach_from == "deviations":
        # What belongs to the part stays so, and its largest deviation is another one.
        reach = float(np.abs(values[deviations.counted]).max(initial=0.0))
    return dataclasses.replace(
        deviations,
        values=values,
        reach=reach,
        points=moved(points, deviations.origin, points),
        closest=moved(closest, deviations.origin, closest),
        faces=faces,
        covariance=covariance,
        centre=centre,
    )
