"""What the page draws: points thinned, in 16-bit steps, each side about its own middle and size."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg._open3d import load_open3d
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.morton import morton_order

# What is drawn at most.
POINTS, OFF = 200_000, 40_000
STEPS = 65535
# Points that a normal is estimated of for the light, and where that comes from.
NEIGHBOURS, LIGHT = 12, np.array([0.36, -0.48, 0.8])


@dataclasses.dataclass(frozen=True)
class Frame:
    """Where a side is drawn: its middle at the origin, its diagonal as the unit."""

    middle: FloatArray  # (3,)
    size: float

    @staticmethod
    def of(points: FloatArray) -> Frame:
        """The frame of some points: outliers far away do not shrink the rest."""
        low, high = bounds(points)
        if len(points) > 1000:
            near = np.quantile(points[:: max(1, len(points) // 20_000)], [0.005, 0.995], axis=0)
            inner = float(np.linalg.norm(near[1] - near[0]))
            if 3.0 * inner < float(np.linalg.norm(high - low)) and inner > 0.0:
                low, high = near
        size = float(np.linalg.norm(high - low))
        return Frame(0.5 * (low + high), size if size > 0.0 else 1.0)

    def to_drawn(self, points: FloatArray) -> FloatArray:
        """Places in the drawing of places of the side."""
        drawn: FloatArray = (points - self.middle) / self.size
        return drawn

    def to_side(self, points: FloatArray) -> FloatArray:
        """Places of the side of places in the drawing."""
        found: FloatArray = points * self.size + self.middle
        return found


def frame_of(geometry: PointCloud | Mesh) -> Frame:
    """The frame that a side is drawn in."""
    return Frame.of(geometry.vertices if isinstance(geometry, Mesh) else geometry.points)


def drawn_pose(T: FloatArray, scale: float, scan: Frame, part: Frame) -> list[float]:
    """A pose as the page moves the drawn scan: 3x4, row by row, from the scan's drawing to the part's."""
    R, t = T[:3, :3], T[:3, 3]
    motion = np.column_stack([R * (scale * scan.size / part.size), part.to_drawn(scale * R @ scan.middle + t)])
    return [float(x) for x in motion.ravel()]


def true_pose(drawn: FloatArray, scale: float, scan: Frame, part: Frame) -> FloatArray:
    """Inverse of `drawn_pose`, with the rotation made exact. Shapes: drawn (12,), returns (4, 4)."""
    motion = np.asarray(drawn, dtype=np.float64).reshape(3, 4)
    U, _, V = np.linalg.svd(motion[:, :3])
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = part.to_side(motion[:, 3]) - scale * R @ scan.middle
    return T


def rows_to_draw(points: FloatArray, on: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows of the points that are drawn: those that count, and the others; each in an order that thins evenly."""
    return _spread(points, np.flatnonzero(on), POINTS), _spread(points, np.flatnonzero(~on), OFF)


def cloud_payload(points: FloatArray, frame: Frame, rows: tuple[IntArray, IntArray]) -> tuple[dict[str, Any], bytes]:
    """Points to draw: what the page must know, and the coordinates, first of those that count."""
    known, steps = quantised(frame.to_drawn(points[np.concatenate(rows)]))
    return {**known, "kind": "cloud", "on": len(rows[0]), "off": len(rows[1]), "total": len(points)}, steps


def shades(points: FloatArray) -> bytes:
    """How bright each point is under a fixed light, a byte each: a scan without light is a silhouette."""
    if len(points) < NEIGHBOURS:
        return b"\xff" * len(points)
    open3d = load_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points - points.mean(axis=0)))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS), fast_normal_computation=True)
    # From both sides alike: the normals have no sign.
    normals = np.abs(np.asarray(cloud.normals) @ LIGHT)
    return as_bytes(np.rint(1 + 253 * np.clip(normals, 0.0, 1.0)), "<u1")


def _spread(points: FloatArray, rows: IntArray, most: int) -> IntArray:
    if len(rows) > most:
        # Even steps along a space-filling curve leave no holes.
        ordered = rows[morton_order(points[rows])]
        rows = ordered[np.linspace(0, len(ordered) - 1, most).astype(np.int64)]
    # In random order any first part of them is as even: less is drawn while the view turns.
    mixed: IntArray = np.random.default_rng(0).permutation(rows)
    return mixed


def quantised(points: FloatArray) -> tuple[dict[str, Any], bytes]:
    """Places in 16-bit steps of their box: what the page must know, and the steps."""
    low = points.min(axis=0) if len(points) else np.zeros(3)
    extent = np.maximum(np.ptp(points, axis=0), 1e-12) if len(points) else np.ones(3)
    known = {"low": low.tolist(), "extent": extent.tolist(), "count": len(points)}
    return known, as_bytes(np.rint((points - low) / extent * STEPS), "<u2")


def padded(data: bytes) -> bytes:
    """Zeros after which numbers of four bytes may follow."""
    return b"\0" * (-len(data) % 4)


def as_bytes(array: NDArray[Any], kind: str) -> bytes:
    """An array as the page reads it."""
    return np.ascontiguousarray(array, dtype=kind).tobytes()
