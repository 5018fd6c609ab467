"""Both sides as the loop takes them: a mesh or a sparse cloud as it is, dense clouds evened out in cells."""

from __future__ import annotations

import dataclasses

from dqreg.geometry import PointCloud, Scan, Surface, prepare_scan
from dqreg.geometry.voxels import WHOLE, EvenCloud, cell_size, even_size, evened
from dqreg.registration.source import CentredSource
from dqreg.registration.target_index import TargetIndex

# A source that fills less than this share of the cells wanted is small beside the target, and asks for smaller ones.
SMALL = 0.5


@dataclasses.dataclass(frozen=True)
class Sides:
    """Scan and surface of a registration."""

    scan: Scan  # Points of the source
    surface: Surface  # The target
    cell: float = 0.0  # Edge of the cells by whose means dense clouds stand, target units; 0 where there are none
    even: bool = False  # Whether both are clouds with a plane fitted at every point that is left

    @staticmethod
    def whole(source: CentredSource, target: TargetIndex, fitted: int | None) -> Sides:
        """Both as they are, with planes fitted at some points of the source."""
        return Sides(prepare_scan(source.cloud, fitted), target.surface)

    @staticmethod
    def evened(source: CentredSource, target: TargetIndex, count: int) -> Sides:
        """Two clouds, thinned to one point a cell where they are denser, with planes fitted at all that are left.

        LiDARs crowd their points near the sensor, where they say least about a turn, and depth cameras give many times
        what noise lets them tell apart. Cells are equal on both sides, so that neither is finer than the other.
        """
        stands = target.evened(count)
        points = source.cloud.points
        size = stands.size or even_size(points, count)
        moves = evened(source.cloud, size)
        if stands.size and len(moves) < SMALL * count and isinstance(target.geometry, PointCloud):
            size = min(size, cell_size(points, min(count, int(WHOLE * len(points)))))
            stands, moves = EvenCloud.of(target.geometry, size), evened(source.cloud, size)
        thinned = stands.surface is not None or moves is not source.cloud
        scan = dataclasses.replace(prepare_scan(moves), total=len(source.cloud))
        return Sides(scan, stands.surface or target.surface, size if thinned else 0.0, even=True)
