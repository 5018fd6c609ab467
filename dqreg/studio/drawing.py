"""Where the page draws scan and part: each side about its own middle and size; and poses between the two."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, bounds
from dqreg.geometry import Mesh, PointCloud


@dataclasses.dataclass(frozen=True)
class DrawnFrame:
    """Where a side is drawn: its middle at the origin, its diagonal as the unit."""

    middle: FloatArray  # (3,)
    size: float

    @staticmethod
    def of(points: FloatArray) -> DrawnFrame:
        """The frame of some points: outliers far away do not shrink the rest."""
        low, high = bounds(points)
        if len(points) > 1000:
            near = np.quantile(points[:: max(1, len(points) // 20_000)], [0.005, 0.995], axis=0)
            inner = float(np.linalg.norm(near[1] - near[0]))
            if 3.0 * inner < float(np.linalg.norm(high - low)) and inner > 0.0:
                low, high = near
        size = float(np.linalg.norm(high - low))
        return DrawnFrame(0.5 * (low + high), size if size > 0.0 else 1.0)

    def to_drawn(self, points: FloatArray) -> FloatArray:
        """Places in the drawing of places of the side."""
        drawn: FloatArray = (points - self.middle) / self.size
        return drawn

    def to_side(self, points: FloatArray) -> FloatArray:
        """Places of the side of places in the drawing."""
        found: FloatArray = points * self.size + self.middle
        return found


def frame_of(geometry: PointCloud | Mesh) -> DrawnFrame:
    """The frame that a side is drawn in."""
    return DrawnFrame.of(geometry.vertices if isinstance(geometry, Mesh) else geometry.points)


def drawn_pose(T: FloatArray, scale: float, scan: DrawnFrame, part: DrawnFrame) -> list[float]:
    """A pose as the page moves the drawn scan: 3x4, row by row, from the scan's drawing to the part's."""
    R, t = T[:3, :3], T[:3, 3]
    motion = np.column_stack([R * (scale * scan.size / part.size), part.to_drawn(scale * R @ scan.middle + t)])
    return [float(x) for x in motion.ravel()]


def true_pose(drawn: FloatArray, scale: float, scan: DrawnFrame, part: DrawnFrame) -> FloatArray:
    """Inverse of `drawn_pose`, with the rotation made exact. Shapes: drawn (12,), returns (4, 4)."""
    motion = np.asarray(drawn, dtype=np.float64).reshape(3, 4)
    U, _, V = np.linalg.svd(motion[:, :3])
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = part.to_side(motion[:, 3]) - scale * R @ scan.middle
    return T
