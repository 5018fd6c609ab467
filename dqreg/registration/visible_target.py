"""A target of which only what the scanner could see is asked."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, require_workable
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.geometry.visibility import VisibleSurface, visible_faces
from dqreg.registration.target_index import TargetIndex


def as_viewpoints(value: Any) -> FloatArray | None:
    """Places of the scanner, checked.

    >>> as_viewpoints([0, 0, 500]).tolist()
    [[0.0, 0.0, 500.0]]
    """
    if value is None:
        return None
    places = as_float(value, "viewpoint")
    if places.ndim not in (1, 2) or places.shape[-1] != 3 or not places.size:
        raise InputError(
            f"viewpoint must be the place of the scanner in source coordinates, (3,), or several, (k, 3); got shape "
            f"{places.shape}"
        )
    if not np.isfinite(places).all():
        raise InputError(f"viewpoint must hold finite numbers; got {places.tolist()}")
    places = np.atleast_2d(places)
    require_workable(np.vstack([places, np.zeros(3)]), "the coordinates of the viewpoint")
    return places


def require_mesh(target: TargetIndex) -> None:
    """Raise where faces cannot be hidden because there are none."""
    if not isinstance(target.geometry, Mesh):
        raise InputError(
            "viewpoint leaves out faces of a mesh that the scanner cannot have seen, and this target is a cloud; "
            "leave viewpoint out, or give the target as a mesh"
        )


def seen_target(target: TargetIndex, viewpoints: FloatArray) -> TargetIndex:
    """The target with a surface of those faces alone that can be seen from some places."""
    require_mesh(target)
    mesh = target.geometry
    assert isinstance(mesh, Mesh)
    seen = visible_faces(mesh, viewpoints)
    if seen.all():
        return target
    if not seen.any():
        raise InputError(
            f"no face of the target can be seen from viewpoint at the pose found (it would be at "
            f"{(viewpoints + target.origin).round(6).tolist()} in target coordinates); is it in source coordinates and "
            "source units?"
        )
    found = dataclasses.replace(target)
    # What was derived from the whole is still right; the surface alone is another.
    vars(found).update({**vars(target), "surface": VisibleSurface(mesh, seen)})
    return found
