"""Source and target as the loop compares them: as they are, or two clouds thinned alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from dqreg.geometry import PointCloud, Scan, Surface
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.scan_preparation import scan_of
from dqreg.geometry.voxels import (
    DENSE_RATIO,
    EVENLY_DENSE,
    STAND_UNEVENNESS,
    WHOLE_SHARE,
    VoxelCloud,
    cell_size,
    voxel_size,
)
from dqreg.kernels.threads import Later
from dqreg.registration.problem.target_index import Evening, TargetIndex

# Begins what is asked of a thinned target beside the caller, once its cells are there; the scan may be whole.
Begin = Callable[[Surface, bool], None]

# A source that fills less than this share of the cells wanted is small beside the target, and asks for smaller ones.
SMALL = 0.5


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Source and target as the loop compares them: points to move, and a surface to ask."""

    scan: Scan
    surface: Surface
    cell_size: float = 0.0  # Edge of the cells by whose means dense clouds stand, target units; 0 where there are none
    even: bool = False  # Whether both are clouds with a plane fitted at every point that is left
    is_whole: bool = True  # Whether the scan is of the points of the source, each place once, and not of means

    @property
    def is_from_a_stand(self) -> bool:
        """Whether the cells of a target are crowded beside its sensor, or of rings: they hold what all points do."""
        return isinstance(self.surface, CellSurface) and (
            self.surface.cells.unevenness > STAND_UNEVENNESS or self.surface.in_rings
        )

    @staticmethod
    def whole(cloud: PointCloud, target: TargetIndex, fitted: int | None) -> Prepared:
        """Both as they are, with planes fitted at some points of the source."""
        return Prepared(scan_of(cloud, fitted, quiet=target.kind == "mesh"), target.surface)

    @staticmethod
    def downsampled(
        cloud: PointCloud, target: TargetIndex, count: int, begin: Begin | None = None, evening: Evening | None = None
    ) -> Prepared:
        """Two clouds, thinned to one point a cell where they are denser, with planes fitted at all that are left.

        LiDARs crowd their points near the sensor, where they constrain a rotation least, and depth cameras give many
        times what noise lets them tell apart. Cells are equal on both sides, so that neither is finer than the other.
        """
        evening = evening or target.begin_evened(count)
        edge = evening.edge
        # Meanwhile, with the cells that the target will have unless its points stay in lines.
        meanwhile = VoxelCloud.across_lines(cloud, edge) if edge and evening.cloud.is_beside else None
        # Cells of an even target save nothing where the source has too few points for cells as small.
        is_small, geometry = len(cloud) <= EVENLY_DENSE * count, target.geometry
        stands = target.evened(count, evenly_dense=DENSE_RATIO) if is_small and not edge else evening.cloud.result()
        if not stands.size or not isinstance(geometry, PointCloud):
            moves = VoxelCloud.of(cloud, voxel_size(cloud, count))
        else:
            made = meanwhile if stands.size == edge and not stands.of_few_rings else None
            moves = made or VoxelCloud.across_lines(cloud, stands.size, of_few_rings=stands.of_few_rings)
            size, wanted = moves.size, min(count, len(stands.cloud))
            if len(moves.cloud) < SMALL * wanted:
                size = min(size, cell_size(cloud, min(count, int(WHOLE_SHARE * len(cloud)))))
                moves = VoxelCloud.of(cloud, size, of_few_rings=stands.of_few_rings)
            if size != stands.size:
                stands = VoxelCloud.of(geometry, size, of_few_rings=stands.of_few_rings)
        thinned = stands.surface is not None or moves.surface is not None
        planes = Later(stands.surface.fit_cells, beside=moves.surface is not None) if stands.surface else None
        if stands.surface is not None and moves.surface is not None:
            # Not waited for: while the loop begins a core is idle, and what is there by then it need not fit.
            stands.surface.begin_rest()
        if begin is not None and stands.surface is not None:
            begin(stands.surface, moves.surface is None)
        scan = scan_of(moves.cloud, surface=moves.surface, total=len(cloud), quiet=False)
        if planes is not None:
            planes.result()
        edge, is_whole = moves.size if thinned else 0.0, moves.surface is None
        return Prepared(scan, stands.surface or target.surface, edge, even=True, is_whole=is_whole)
