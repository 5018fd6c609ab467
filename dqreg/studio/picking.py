"""What lies under the pointer: places of the drawing as places of the part and of the scan."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray, as_float, as_vectors
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.raycasting import RayScene
from dqreg.studio.cleaning import kept_rows, scan_points
from dqreg.studio.drawing import DrawnFrame, frame_of
from dqreg.studio.reading import triangle_labels
from dqreg.studio.visit import Cut
from dqreg.studio.worker_cache import Place, cached

# Points that make a surface, and their share of the most at any depth.
MIN_SURFACE_POINTS, MIN_SHARE_OF_MOST = 3, 0.15
# How deep it may lie, in radii of what is near.
MAX_DEPTH_RADII = 2.0
# Points nearest to the pointer, of which the one of middle depth is meant.
POINTER_POINTS = 5
STANDING_MOTION = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Look:
    """A place of the canvas, and how it is looked at, in the drawing of the part."""

    at: FloatArray  # (3,): In the plane through the middle of the view
    axes: FloatArray  # (3, 3): Right, up and towards the eye, one a row
    radius: float  # How near is near
    motion: FloatArray  # (3, 4): How the scan is moved

    @staticmethod
    def of(values: dict[str, Any]) -> Look:
        """From what the page sends."""
        motion = as_float(values.get("motion") or STANDING_MOTION, "motion")
        axes = as_vectors(values.get("axes"), "axes")
        at = as_float(values.get("at") or [0.0, 0.0, 0.0], "at")
        radius = float(as_float(values.get("radius") or 0.01, "radius").reshape(-1)[0])
        if motion.shape != (12,) or axes.shape != (3, 3) or at.shape != (3,) or not np.isfinite(motion).all():
            raise InputError("a look needs at, axes and motion: 3, 3 x 3 and 12 numbers")
        return Look(at, axes, radius, motion.reshape(3, 4))

    def across(self, frame: DrawnFrame) -> tuple[FloatArray, FloatArray]:
        """Axes and shifts by which places of the scan become places of the canvas. Shapes: (3, 3), (3,)."""
        turned = self.axes @ self.motion[:, :3] / frame.size
        return turned, self.axes @ self.motion[:, 3] - turned @ frame.middle


def pick_part(place: Place, values: dict[str, Any]) -> dict[str, Any]:
    """The place of the part under the pointer, its face and its normal; None where there is none."""
    look, part = Look.of(values), place.part()
    frame = frame_of(part)
    if isinstance(part, PointCloud):
        return {"point": _nearest(part.points, look.axes / frame.size, -look.axes @ frame.middle / frame.size, look)}
    scene, labels = _scene(place, part)
    origin = look.at + 3.0 * look.axes[2]
    face, distance = scene.first_faces(np.concatenate([origin, -look.axes[2]])[None])
    if face[0] < 0:
        return {"point": None}
    # In float64 on the plane of the triangle that was met.
    corner, normal = frame.to_drawn(part.corners[face[0]])[0], part.face_normals[face[0]]
    along = float(normal @ -look.axes[2])
    away = float(normal @ (corner - origin)) / along if abs(along) > 1e-9 else float(distance[0])
    point = frame.to_side(origin - away * look.axes[2])
    return {"point": point.tolist(), "face": int(labels[face[0]]), "normal": normal.tolist()}


def pick_scan(place: Place, values: dict[str, Any]) -> dict[str, Any]:
    """The point of the scan under the pointer; None where there is none."""
    look, scan = Look.of(values), place.scan()
    points = scan_points(scan)
    points = points[kept_rows(points, place.visit.cuts)]
    return {"point": _nearest(points, *look.across(frame_of(scan)), look)}


def lasso_cut(place: Place, values: dict[str, Any]) -> Cut:
    """An outline on the canvas as a cut of the scan."""
    look = Look.of(values)
    axes, shift = look.across(frame_of(place.scan()))
    outline = as_float(values.get("polygon"), "polygon")
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise InputError("a lasso needs three corners at least")
    corners = outline - shift[:2]
    polygon = tuple((float(x), float(y)) for x, y in corners)
    right, up = (tuple(float(x) for x in row) for row in axes[:2])
    return Cut("lasso", bool(values.get("keep")), right=right, up=up, polygon=polygon)  # type: ignore[arg-type]


def _nearest(points: FloatArray, axes: FloatArray, shift: FloatArray, look: Look) -> list[float] | None:
    seen = points @ axes.T + shift
    goal = look.axes @ look.at
    off = (seen[:, 0] - goal[0]) ** 2 + (seen[:, 1] - goal[1]) ** 2
    near = np.flatnonzero(off < look.radius**2)
    if not len(near):
        return None
    # The surface in front: the first depth at which many points lie together. A few strays before it are none.
    depth = np.sort(seen[near, 2])[::-1]
    together = np.searchsorted(-depth, MAX_DEPTH_RADII * look.radius - depth, side="right") - np.arange(len(depth))
    front = depth[np.argmax(together >= max(min(MIN_SURFACE_POINTS, len(depth)), MIN_SHARE_OF_MOST * together.max()))]
    window = MAX_DEPTH_RADII * look.radius
    middle = np.median(depth[(depth <= front) & (depth >= front - window)])
    surface = near[np.abs(seen[near, 2] - middle) <= window]
    # Of the few that are nearest to the pointer the one in the middle: a stray close to the surface is none either.
    nearest = surface[np.argsort(off[surface])[:POINTER_POINTS]]
    found: list[float] = points[nearest[np.argsort(seen[nearest, 2])[len(nearest) // 2]]].tolist()
    return found


def _scene(place: Place, part: Mesh) -> tuple[RayScene, IntArray]:
    def make() -> tuple[RayScene, IntArray]:
        frame, labels = frame_of(part), triangle_labels(place)
        assert labels is not None
        return RayScene(part.vertices, part.faces, frame.middle, frame.size), labels

    return cached("rays", [place.part_path], make)
