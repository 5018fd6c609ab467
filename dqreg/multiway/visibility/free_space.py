"""What the scanners looked through: how much of two scans stands where the other one shows that nothing is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.scans.scans import View, every_so_many
from dqreg.multiway.visibility.viewpoints import Viewpoints
from dqreg.rigid import pose
from dqreg.trust.free_space import MIN_COMPARED, DepthImage
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE

# Points of a scan that are looked at, and cells of free space in spacings of them.
COMPARED_POINTS, CELL_SPACINGS = 3_000, 4.0


@dataclasses.dataclass(frozen=True)
class FreeSpace:
    """The image that each scanner had, and points of each scan, in the frames of the scans."""

    points: tuple[FloatArray | None, ...]
    images: tuple[DepthImage | None, ...]
    spacings: FloatArray  # (n,): Of the points that are looked at

    @staticmethod
    def of(views: Sequence[View], viewpoints: Viewpoints) -> FreeSpace:
        """Images of the scans whose viewpoints are known."""
        points = tuple(
            every_so_many(view.scan.points, COMPARED_POINTS) + view.origin if view.usable else None for view in views
        )
        images = tuple(
            None if some is None or viewpoint is None else DepthImage.of(some, viewpoint.place + view.origin)
            for view, some, viewpoint in zip(views, points, viewpoints, strict=True)
        )
        spacings = [
            np.nan if some is None else view.scan.spacing * np.sqrt(len(view.scan.points) / len(some))
            for view, some in zip(views, points, strict=True)
        ]
        return FreeSpace(points, images, np.array(spacings))

    def share(self, i: int, j: int, T_i_j: FloatArray) -> float:
        """Share of the compared points of two scans that stand where the other one's scanner looked through.

        NaN where too few can be compared.
        """
        margin = CELL_SPACINGS * max(self.spacings[i], self.spacings[j])
        nearer = alike = 0
        for image, points, T in ((self.images[i], self.points[j], T_i_j), (self.images[j], self.points[i], None)):
            if image is not None and points is not None:
                counts = image.compared(pose.apply(pose.inverse(T_i_j) if T is None else T, points), margin)
                nearer, alike = nearer + counts[0], alike + counts[1]
        return nearer / (nearer + alike) if nearer + alike >= MIN_COMPARED else np.nan

    def contradictions(self, T_world_scan: FloatArray) -> FloatArray:
        """By how much each pair of placed scans exceeds the share that is allowed, (n, n); 0 where it does not."""
        count = len(self.points)
        found = np.array([self.contradictions_of(k, T_world_scan, range(k + 1, count)) for k in range(count)])
        return np.asarray(found + found.T)

    def contradictions_of(self, k: int, T_world_scan: FloatArray, others: Iterable[int] | None = None) -> FloatArray:
        """The same of one scan and others, (n,)."""
        found = np.zeros(len(self.points))
        if not self._stands(k, T_world_scan):
            return found
        T_k_world = pose.inverse(T_world_scan[k])
        for j in range(len(self.points)) if others is None else others:
            if j != k and self._stands(j, T_world_scan):
                found[j] = max(np.nan_to_num(self.share(k, j, T_k_world @ T_world_scan[j])) - DEPTH_CONFLICT_SHARE, 0.0)
        return found

    def _stands(self, k: int, T_world_scan: FloatArray) -> bool:
        return self.points[k] is not None and bool(np.isfinite(T_world_scan[k]).all())
