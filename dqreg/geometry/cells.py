"""Cells of a cloud: one point of each stands for its points, and planes come from the moments of neighbouring ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, dot
from dqreg.geometry.beams import Beams
from dqreg.geometry.boundary import LINE_VARIANCE_RATIO, ONE_SIDED, CloudBoundary
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.morton import (
    ASIDE_POINTS,
    CodeArray,
    codes_on_grid,
    corner_and_cells,
    edge_of_cells,
    sorted_codes,
)
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, PlaneFits, fit_planes_around, fit_planes_at, fit_wide_planes
from dqreg.geometry.surface import Closest
from dqreg.kernels.threads import Later, unlocked_property

# Cells count as neighbours whose means are within so many edges, in their block of eight or those around it: about
# twenty of a surface.
REACH_EDGES = 2.5
# Times the usual residual from which on that of the neighbours is of their shape, as at an edge, and not noise: their
# mean is moved by the share of the squares then.
SHAPE_RESIDUAL_RATIO = 2.0
# Points of a cell that count at most: near a sensor, or where a thousand returns are copies, one cell has most of them.
MAX_COUNTED_POINTS = 8.0
# Points without which neighbouring cells make no plane, and the same of the ratio of their smaller to their larger
# variance: rings of a LiDAR that stand apart. Their nearest cells are searched for.
MIN_PLANE_POINTS, MIN_PLANE_VARIANCE_RATIO = 8.0, 0.02
# In rings a plane of neighbours that leaves so many times the usual residual is of two faces.
MIXED_RESIDUAL_RATIO = 3.0
# One that most neighbours lie in holds them within so many times of it.
HELD_RESIDUALS = 2.5
# The products of two of the three variances of a cell come to less than this share of the square of their sum where the
# second is below 0.38 of the first; points of a cell that tell.
LINED_PRODUCTS, TOLD_POINTS = 0.2, 8.0
# Share of the sure planes that hold a direction, below which rings are looked for and planes sought among more
# neighbours: floors of few rings came to 0.05 at most, roads, streets, rooms and parts to 0.1 and more.
LEAST_HELD = 0.07
# Share of the cells that such planes are found for at least.
FEWEST_WIDE = 0.01
# Blocks of eight cells that one thread goes over at a time.
CHUNK_BLOCKS = 512
# Edges, each twice the one before, of the cells that are asked for planes. With a third a road took 4 % less time, and
# streets came nearer by 6 %, but the fast effort on the road lost 14 %.
EDGE_LEVELS = 2


@dataclasses.dataclass(frozen=True)
class CellPlanes:
    """Planes at the means of cells, through those of neighbouring ones."""

    means: FloatArray  # (m, 3): The means of the points of each cell
    fits: PlaneFits
    rims: BoolArray  # (m,): Which of the means lie on a rim
    heights: FloatArray  # (m,): From the mean along the normal to the surface that the neighbours make; 0 if unknown
    usual: float  # Median of the residuals; NaN where there is no plane
    smoothed_by: float  # Median of how high the surface is, either way


@dataclasses.dataclass(frozen=True)
class Cells:
    """The cells that hold points of a cloud, in Morton order."""

    size: float  # Edge
    codes: CodeArray  # (m,): Numbers along the Z-order curve
    counts: FloatArray  # (m,): Points in each
    points: FloatArray  # (m, 3): Their means, or these moved to the surface that the neighbours make
    scatters: FloatArray  # (m, 6): Sums of products of their offsets from the mean: xx, yy, zz, xy, xz, yz
    _grid: tuple[PointCloud, FloatArray, float]  # The cloud, and what `corner_and_cells` says of it

    @staticmethod
    def of(cloud: PointCloud, size: float) -> Cells:
        """Cells of an edge: wider where the extent of the cloud has too many of them."""
        from dqreg.kernels.cells.grid_cells import cells_of_points
        from dqreg.kernels.threads import as_plain, aside

        (points, move), ends = cloud._unmoved, cloud._ends
        low, per_edge = corner_and_cells(points, size, ends)
        given = as_plain(points), move, as_plain(low), per_edge
        found = aside(cells_of_points, *given) if len(points) > ASIDE_POINTS else cells_of_points(*given)
        codes, counts, means, scatters = found
        return Cells(edge_of_cells(points, size, ends), codes, counts, means, scatters, (cloud, low, per_edge))

    @unlocked_property
    def order(self) -> IntArray:
        """Rows of the cloud, cell by cell, (n,)."""
        cloud, low, per_edge = self._grid
        return sorted_codes(codes_on_grid(cloud.points, low, per_edge))[0]

    @unlocked_property
    def starts(self) -> IntArray:
        """Where each cell begins among these, (m,)."""
        ends: IntArray = np.cumsum(self.counts).astype(np.int64)
        return ends - self.counts.astype(np.int64)

    @property
    def unevenness(self) -> float:
        """How many others the points have in their cell, over what points strewn at random would have; about 1."""
        mean = self.counts.mean()
        return float(dot(self.counts, self.counts) / len(self.counts) / mean / (mean + 1.0))

    @property
    def lined_share(self) -> float:
        """Share of the cells of many points whose points lie along a line, as on one ring of a LiDAR; 0 for none."""
        from dqreg.kernels.cells.cell_smoothing import share_of_lined

        return share_of_lined(self.counts, self.scatters, TOLD_POINTS, LINED_PRODUCTS)

    def planes(self) -> CellPlanes:
        """Planes at the means where neighbouring cells make one.

        Where they are too few, those of cells of twice the edge are asked, so many times.
        """
        from dqreg.kernels.cells.cell_smoothing import plane_columns

        found, rims = self._planes(np.ones(len(self.codes), dtype=bool), EDGE_LEVELS)
        normals, residuals, levers, gaps, heights, usual, height = plane_columns(found)
        fits = PlaneFits(normals, residuals, levers, NORMAL_NEIGHBOURS, gaps)
        return CellPlanes(self.points, fits, rims, heights, usual, height)

    def smoothed(self, planes: CellPlanes) -> Cells:
        """The same with each mean moved along its normal to the surface that the neighbouring means make.

        The mean of a few points is off by their noise. Of means so strewn the nearest one is that which leans the way
        of the query: a loop between such clouds follows only a part of what the pose is off, and its residuals, small
        as they were chosen, tell too small a variance.
        """
        from dqreg.kernels.cells.cell_smoothing import smoothed_means

        fits = planes.fits
        given = self.points, fits.normals, fits.residuals, planes.heights, SHAPE_RESIDUAL_RATIO * planes.usual
        return dataclasses.replace(self, points=smoothed_means(*given))

    def _planes(self, asked: BoolArray, levels: int) -> tuple[FloatArray, BoolArray]:
        """Planes of some of the cells, see `cell_planes`, and which of these lie on a rim."""
        from dqreg.kernels.cells.cell_blocks import cell_blocks, hand_down, joined_cells
        from dqreg.kernels.cells.cell_planes import cell_planes
        from dqreg.kernels.threads import over_chunks

        of_blocks = cell_blocks(self.codes, self.counts, self.scatters, MAX_COUNTED_POINTS)
        starts, blocks, table, weights, weighted = of_blocks
        found, rims = np.zeros((len(self.codes), 7)), np.zeros(len(self.codes), dtype=bool)
        given = starts, blocks, table, self.points, weights, weighted
        limits = REACH_EDGES * self.size, MIN_PLANE_POINTS, MIN_PLANE_VARIANCE_RATIO, ONE_SIDED, LINE_VARIANCE_RATIO
        over_chunks(cell_planes, len(starts) - 1, *given, *limits, asked, found, rims, chunk=CHUNK_BLOCKS)
        if levels > 1:
            counts, means, scatters, asked = joined_cells(starts, self.counts, self.points, self.scatters, found)
            if asked.any():
                codes = self.codes[starts[:-1]] >> np.uint64(3)
                cloud, low, per_edge = self._grid
                wide = Cells(2.0 * self.size, codes, counts, means, scatters, (cloud, low, 0.5 * per_edge))
                hand_down(starts, *wide._planes(asked, levels - 1), found, rims)
        return found, rims


class CellSurface(CloudSurface):
    """Points of cells, in the order of these, as a surface."""

    def __init__(
        self,
        points: PointCloud,
        cells: Cells,
        planes: CellPlanes | None = None,
        in_rings: Callable[[], bool] = bool,
        beams: Callable[[], Beams] = Beams,
        *,
        of_few_rings: bool = False,
    ) -> None:
        # Whether the points are known to lie in few rings: planes are sought among more neighbours where the next ones
        # make none. And where some were found, and where none is to be had.
        self.cells, self._look_at_rings, self.of_few_rings = cells, in_rings, of_few_rings
        self._find_beams, self.has_wide = beams, False
        self.wide, self._bare = np.zeros((2, len(cells.codes)), dtype=bool)
        self._cell_planes = planes
        self._rest: Later[None] | None = None
        # Median of how far the points were moved to the surface of their neighbours.
        self.smoothed_by = 0.0 if planes is None else planes.smoothed_by
        super().__init__(points, derived=True)

    @property
    def _means(self) -> FloatArray:
        """Means of the points of each cell, (m, 3), with all of their noise."""
        return self._points if self._cell_planes is None else self._cell_planes.means

    @unlocked_property
    def in_rings(self) -> bool:
        """Whether the points that the cells hold lie in rings, as a LiDAR's: looked at when first asked."""
        return self.of_few_rings or self._look_at_rings()

    def _ordered(self, points: FloatArray) -> IntArray:
        # Cells are in Morton order, and each has one point.
        return np.arange(len(points))

    @unlocked_property
    def _of_cells(self) -> tuple[PlaneFits, BoolArray, BoolArray]:
        """Planes where neighbouring cells make one, which of these lie on a rim, and where there is none, (m,)."""
        planes = self.cells.planes() if self._cell_planes is None else self._cell_planes
        fits = self._widened(planes.fits, planes.usual) if np.isfinite(planes.usual) else planes.fits
        return fits, planes.rims, ~fits.known & ~self._bare

    def _widened(self, fits: PlaneFits, noise: float) -> PlaneFits:
        """In few rings, replace planes across two faces, and of cells along a line, by those that most neighbours hold.

        Where a ring of a LiDAR meets a floor its neighbours are on that ring or on the wall beyond: the plane through
        both stands across them, and few as they are, nothing else may hold a motion. Where no plane holds so many there
        is none.
        """
        most = MIXED_RESIDUAL_RATIO * noise
        if not (self.of_few_rings or (_least_held(fits, most) < LEAST_HELD and self.in_rings)):
            return fits
        known, beams = fits.known, self._find_beams()
        noise = beams.noise_of_cells(noise, self.cells.size)
        sure = known & ~(fits.residuals > MIXED_RESIDUAL_RATIO * noise)
        rows = np.flatnonzero(~sure)
        wide = fit_wide_planes(self._tree, self._points, rows, noise, HELD_RESIDUALS * noise)
        found = np.flatnonzero(wide.known)
        if len(found) < FEWEST_WIDE * len(known):
            # Of a plate whose points are strewn at random some neighbours lie in lines by chance.
            return fits
        # Threads that meet here begin with the same planes.
        fits = fits.copied()
        fits.replace(rows, wide)
        found = rows[found]
        # Round a corner all points of a ring lie in one plane, that of its beams.
        found = found[~beams.along(self._points, fits.normals, sure)[found]]
        self.wide[found], self.has_wide = True, bool(len(found))
        # The next ones would make a plane along a ring or across faces.
        self._bare[rows] = ~self.wide[rows]
        fits.clear(self._bare)
        return fits

    def fit_cells(self) -> None:
        """Fit the planes of the cells, which whoever asks for matches needs."""
        fits, _, missing = self._of_cells
        rows = np.flatnonzero(~(missing | self._known))
        self._enter(rows, fits.taken(rows))

    def begin_rest(self) -> None:
        """Fit planes where neighbouring cells make none beside the caller, then order the tree for many queries."""
        self._rest = Later(self._fit_rest)
        self._tree.begin()

    def _fit_rest(self) -> None:
        rows = np.flatnonzero(self._of_cells[2] & ~self._known)
        if len(rows):
            self._enter(rows, fit_planes_around(self._tree, self._points, rows))

    def _fit_at(self, rows: IntArray) -> None:
        # What is being fitted beside is waited for: it is there sooner than some of it once more.
        if self._rest is not None and self._rest.is_begun and not self._known[rows].all():
            self._rest.result()
            self._rest = None
        super()._fit_at(rows)

    def _fitted_around(self, rows: IntArray) -> PlaneFits:
        fits, _, missing = self._of_cells
        around = missing[rows]
        return _completed(fits.taken(rows), around, lambda at: fit_planes_around(self._tree, self._points, rows[at]))

    def _all_planes(self) -> PlaneFits | None:
        fits, _, missing = self._of_cells
        return _completed(fits.copied(), missing, lambda rows: fit_planes_at(self._tree, self._points, rows))

    def on_rim(self, closest: Closest) -> BoolArray:
        """Whether the matches of some queries are boundary points: where cells make a plane, by these."""
        # Rings end everywhere: a floor that one or two of them meet is all rim, and nothing else may hold a motion.
        if self.has_wide or self._in_lines:
            return np.zeros(len(closest.elements), dtype=bool)
        return self._rims.at(closest.elements, closest.normals)

    @unlocked_property
    def _rims(self) -> CloudBoundary:
        """What is known of the rim by cells, and found beside them."""
        _, rims, missing = self._of_cells
        return self._boundary.knowing(rims.copy(), ~missing)


def _least_held(fits: PlaneFits, most: float) -> float:
    """Share of the normals of planes that leave no more, in the direction that they hold least."""
    from dqreg.kernels.cells.cell_smoothing import held_by_sure

    held, count = held_by_sure(fits.normals, fits.residuals, most)
    return float(np.linalg.eigvalsh(held)[0]) / max(count, 1)


def _completed(fits: PlaneFits, missing: BoolArray, fitted: Callable[[IntArray], PlaneFits]) -> PlaneFits:
    """Planes with those that are missing, (m,), fitted."""
    rows = np.flatnonzero(missing)
    if len(rows):
        fits.replace(rows, fitted(rows))
    return fits
