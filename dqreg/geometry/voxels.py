"""Voxel downsampling: one point for those in each cell of a grid."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from dqreg._arrays import bounds
from dqreg.geometry.beams import Beams, beams_of
from dqreg.geometry.boundary import lie_in_rings
from dqreg.geometry.cells import Cells, CellSurface
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.morton import cells_by_edge

# A cloud is downsampled from so many times the wanted points on: below, it costs accuracy and saves little.
DENSE_RATIO = 3.0
# The same where points lie evenly: below, most cells hold one. Of simulated bodies and parts, 16,000 to 30,000 points
# in 10,000 cells, poses took 0.4 to 0.5 of the time and, with noise of 0.1 to 1 of the spacing, came 0.3 to 1.0 times
# as far off as by all points; a LiDAR on a car came twice as far off.
EVENLY_DENSE = 1.6
# Unevenness of its cells from which on a cloud was taken from a stand: a LiDAR or a depth camera sees the near places
# many times as densely, and came to 2 to 50, where all points gained nothing over the cells, or 5 to 10 % in five times
# the time; range scans of bodies came to 1.6 at most.
STAND_UNEVENNESS = 2.0
# Crowded in places so many times as much as by chance, a cloud is downsampled from fewer points on: a LiDAR that turns
# has its points along rings, where 16 neighbours make no plane, and comes to 20 to 50; other scans came to 4 at most.
RING_UNEVENNESS = 10.0
# The same of a cloud in rings, whatever its number of points: fewer wide voxels hold points of several rings. They are
# looked for from this unevenness on: sweeps of 8 to 32 rings with their floor cut off came to 1.4 and more.
RINGED_RATIO, SWEPT_UNEVENNESS = 6.0, 1.2
# A dense cloud with a larger share of cells of one ring is of few rings: sweeps of 16 came to 0.85 and more, of 64 to
# 0.68 at most, of 32 to anything. Cells are widened while more than the second share of them are of one.
FEW_RINGS_SHARE, ONE_RING_SHARE = 0.75, 0.85
# Where the neighbourhoods are lines still, as in a LiDAR of few rings, voxels are widened by this factor, so many times
# at most and while so many points are left; so are those of one ring.
WIDENING_FACTOR = 1.25
MAX_WIDENINGS, MIN_VOXEL_POINTS = 10, 1_000
# A cloud of which more than this fraction would remain is left as it is.
WHOLE_SHARE = 2.0 / 3.0
# Doublings of the least edge from which on cells are counted first, at a quarter of the cost: 2,048 to an extent.
COARSER_DOUBLINGS = 10


def voxel_size(cloud: PointCloud, count: int) -> float:
    """Edge of the voxels that leave a dense cloud about so many points; 0 for one that is left as it is."""
    return cell_size(cloud, count) if len(cloud) > DENSE_RATIO * count else 0.0


@dataclasses.dataclass(frozen=True)
class VoxelCloud:
    """A cloud with one point a voxel."""

    size: float  # Edge of a voxel; 0 where the cloud was not to be downsampled
    cloud: PointCloud  # Points of the voxels; the cloud itself where it has hardly more points than they
    # The same as a surface; None where the cloud is whole, for whoever has it has its surface
    surface: CellSurface | None

    @property
    def of_few_rings(self) -> bool:
        """See `CellSurface`."""
        return self.surface is not None and self.surface.of_few_rings

    @property
    def in_lines(self) -> bool:
        """Whether the points are in lines still, and so many that wider voxels may be taken."""
        return self.surface is not None and len(self.cloud) >= MIN_VOXEL_POINTS and self.surface._in_lines

    @staticmethod
    def of(
        cloud: PointCloud,
        size: float,
        *,
        cells: Cells | None = None,
        of_few_rings: bool = False,
        smooth: bool = True,
    ) -> VoxelCloud:
        """Downsample a cloud, of which its cells may be known, and whether it is of few rings.

        Its points are the means of the voxels, moved to the surface of their neighbours if smooth.
        """
        if cells is None and size > 0.0:
            cells = Cells.of(cloud, size)
        if cells is None or len(cells.counts) >= WHOLE_SHARE * len(cloud):
            return VoxelCloud(size, cloud, None)
        planes = cells.planes() if smooth else None
        cells = cells if planes is None else cells.smoothed(planes)
        even, in_rings = points_of(cloud, cells), partial(_lie_in_rings, cloud, cells)
        beams = partial(_beams_of, cloud, cells)
        return VoxelCloud(size, even, CellSurface(even, cells, planes, in_rings, beams, of_few_rings=of_few_rings))

    @staticmethod
    def across_lines(
        cloud: PointCloud, size: float, *, cells: Cells | None = None, of_few_rings: bool = False
    ) -> VoxelCloud:
        """Downsample a cloud, with wider voxels where its points stay in lines: all neighbours are on their own then.

        There is no plane through a line, and fits to one would turn any way.
        """
        found = VoxelCloud.of(cloud, size, cells=cells, of_few_rings=of_few_rings)
        for _ in range(MAX_WIDENINGS):
            if not found.in_lines:
                break
            found = VoxelCloud.of(cloud, WIDENING_FACTOR * found.size, of_few_rings=of_few_rings)
        return found

    @staticmethod
    def evened(
        cloud: PointCloud, count: int, size: float | None = None, *, evenly_dense: float = EVENLY_DENSE
    ) -> VoxelCloud:
        """A dense cloud with about so many points, an uneven one or one in rings with fewer; others as they are.

        It begins with the size of `first_size`, where that is known already. One whose points lie evenly is dense from
        so many points a cell on.
        """
        size = first_size(cloud, count) if size is None else size
        if not size > 0.0:
            return VoxelCloud(0.0, cloud, None)
        cells, is_dense = Cells.of(cloud, size), len(cloud) > DENSE_RATIO * count
        # Of a dense cloud, which has cells in any case, it is asked later or not at all, but where these are lines.
        fewest = MIN_VOXEL_POINTS * (1.0 if cells.unevenness > SWEPT_UNEVENNESS else RINGED_RATIO)
        may_be_few = cells.lined_share > FEW_RINGS_SHARE if is_dense else len(cloud) >= fewest
        if may_be_few and _lie_in_rings(cloud, cells):
            size = _across_rings(cloud, first_size(cloud, count, RINGED_RATIO))
            return VoxelCloud.across_lines(cloud, size, of_few_rings=True)
        if not is_dense and len(cloud) > evenly_dense * count and cells.unevenness <= STAND_UNEVENNESS:
            return VoxelCloud.across_lines(cloud, first_size(cloud, count, evenly_dense))
        is_uneven = is_dense or cells.unevenness > RING_UNEVENNESS
        if is_uneven or VoxelCloud.of(cloud, size, cells=cells, smooth=False).in_lines:
            return VoxelCloud.across_lines(cloud, size, cells=cells)
        return VoxelCloud(0.0, cloud, None)


def _lie_in_rings(cloud: PointCloud, cells: Cells) -> bool:
    return lie_in_rings(cloud.points, cells.order)


def _beams_of(cloud: PointCloud, cells: Cells) -> Beams:
    return beams_of(cloud.points, cells.order)


def _across_rings(cloud: PointCloud, size: float) -> float:
    """Edge, from a first one on, of cells not nearly all of which hold points of one ring alone.

    The denser the points on each ring, the smaller are cells of so many.
    """
    cells = Cells.of(cloud, size)
    while cells.lined_share > ONE_RING_SHARE:
        cells = Cells.of(cloud, WIDENING_FACTOR * size)
        if len(cells.codes) < MIN_VOXEL_POINTS:
            break
        size *= WIDENING_FACTOR
    return size


def first_size(cloud: PointCloud, count: int, dense: float = DENSE_RATIO) -> float:
    """Edge of the voxels that evening a cloud to about so many points begins with, so many in each at least."""
    return cell_size(cloud, min(count, int(len(cloud) / dense)))


def cell_size(cloud: PointCloud, count: int) -> float:
    """Edge of the cubic cells of which the points fill about so many."""
    from dqreg.kernels.order.morton import BITS

    if len(cloud) <= count:
        return 0.0
    # Dropping three bits of a Morton code doubles the edge: one sort counts the cells of every such size.
    ends = cloud._ends
    for finest in (COARSER_DOUBLINGS, 0):
        filled = cells_by_edge(*cloud._unmoved, ends, finest)
        if filled[0] > count:
            break
    else:
        return 0.0
    level = int(np.searchsorted(-filled, -count))
    # Between two sizes the logarithm of the number is nearly a line.
    finer, coarser = np.log(filled[level - 1 : level + 1])
    part = (finer - np.log(count)) / (finer - coarser)
    extent = float(np.subtract(*ends[::-1]).max())
    return float(extent / (2**BITS - 1) * 2.0 ** (finest + level - 1 + part))


def points_of(cloud: PointCloud, cells: Cells) -> PointCloud:
    """One point for each cell, with the mean of the normals of those in it."""
    if cloud.normals is None:
        # Of points that were checked nothing has to be checked again.
        return cloud._changed(points=cells.points, times=None, _known_ends=bounds(cells.points))
    columns = [np.add.reduceat(column[cells.order], cells.starts) for column in cloud.normals.T]
    normals = np.column_stack(columns)
    cancelled = np.abs(normals).max(axis=1) <= 1e-6 * cells.counts
    normals[cancelled] = cloud.normals[cells.order[cells.starts[cancelled]]]
    return cloud._standing_for(cells.points, normals)
