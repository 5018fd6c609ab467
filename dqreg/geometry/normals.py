"""Normals from local plane fits with their variances, so that edges and grazing views get less weight."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._records import replaced
from dqreg.geometry.neighbours import NeighbourTree

NORMAL_NEIGHBOURS = 16
# Neighbours without which no residual of a plane is left.
MIN_NEIGHBOURS = 4
# By an edge, planes that are tried pass through the point and two of so many nearest neighbours, in directions that are
# so far apart.
TRIED_NEIGHBOURS, MIN_APART_SIN = 8, 0.4
# Neighbours in the plane, the point among them, without which there is none; rounds of the fit to those.
MIN_HELD_NEIGHBOURS, HELD_ROUNDS = 6, 3
# Where a plane is sought among more neighbours: so many, every which of them planes are tried through.
WIDE_NEIGHBOURS, TRIED_STEP = 40, 3
# Share of these that it holds. A line and one more point make a plane, and with another line by chance: of 9,000 planes
# of cells under 16 rings those that were no face held 13 at most, but for one in ten, the others 14 and more.
WIDE_SHARE = 0.4
# Times of the usual residual's square that the second variance of those it holds has at least. Noise alone has one: of
# a ring whose points scatter along the beams, what seems the plane is that of the beams.
MIN_SPREAD_RATIO = 9.0
# Points, and points by an edge, that one thread goes over at a time.
CHUNK_PLANES, CHUNK_EDGE_PLANES = 512, 256
# Bounds the memory of one step: 16 neighbours of 65,536 points are 25 MB.
CHUNK_POINTS = 65_536


@dataclasses.dataclass(frozen=True)
class PlaneFits:
    """Planes fitted to the neighbours of n points."""

    # (n, 3): Unit normals; the sign is arbitrary unless a viewpoint oriented them. NaN where the neighbours lie on a
    # line
    normals: FloatArray
    # (n,): Root mean square distance sigma_r of the k neighbours from their plane, with k - 3 degrees of freedom
    residuals: FloatArray
    # (n,): ``1 / (1/l1 + 1/l2)`` with the two tangential variances of the neighbours: a squared length that relates the
    # variance of a point to that of its normal: ``sigma_n^2 = sigma_r^2 / (k lever)``
    lever: FloatArray
    count: int  # Neighbours k used a fit
    # (n,): Distance from each place to the second nearest point, the nearest other one of a point of the cloud; None
    # where the neighbours were known before, without their distances
    gaps: FloatArray | None = None
    neighbours: IntArray | None = None  # (n, k): Rows of the neighbours, where the planes were fitted in one go

    def taken(self, rows: IntArray) -> PlaneFits:
        """Those at some of the points."""
        gaps = None if self.gaps is None else self.gaps[rows]
        return PlaneFits(np.take(self.normals, rows, axis=0), self.residuals[rows], self.lever[rows], self.count, gaps)

    def copied(self) -> PlaneFits:
        """The same to put others in."""
        gaps = None if self.gaps is None else self.gaps.copy()
        return PlaneFits(self.normals.copy(), self.residuals.copy(), self.lever.copy(), self.count, gaps)

    def replace(self, rows: IntArray, others: PlaneFits) -> None:
        """Put others at some of the points."""
        self.normals[rows], self.residuals[rows], self.lever[rows] = others.normals, others.residuals, others.lever
        if self.gaps is not None and others.gaps is not None:
            self.gaps[rows] = others.gaps

    def clear(self, rows: BoolArray) -> None:
        """Take those of some of the points away, (n,)."""
        self.normals[rows], self.residuals[rows], self.lever[rows] = np.nan, np.nan, 0.0

    @property
    def known(self) -> BoolArray:
        """Where there is a plane, (n,)."""
        # As kernels ask: one coordinate tells of all three.
        return np.isfinite(self.normals[:, 0])

    @property
    def variances(self) -> FloatArray:
        """Variance of each normal about one tangential axis plus the other, in rad^2, (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            variance: FloatArray = self.residuals**2 / (self.count * self.lever)
        return np.where(self.lever > 0.0, variance, np.inf)


def fit_planes(
    tree: NeighbourTree,
    cloud: FloatArray,
    at: FloatArray,
    count: int = NORMAL_NEIGHBOURS,
    beside: IntArray | None = None,
) -> PlaneFits:
    """Fit a plane to the nearest neighbours of each query, beside one of the points where that is known, (m,)."""

    def nearest(part: slice) -> tuple[IntArray, FloatArray]:
        return tree.nearest(at[part], count) if beside is None else tree.nearest_beside(at[part], beside[part], count)

    return _fit_near(nearest, len(at), cloud, min(count, tree.size))


def fit_planes_at(tree: NeighbourTree, cloud: FloatArray, rows: IntArray) -> PlaneFits:
    """The same at points of the tree itself, (m,) rows."""
    return _fit_near(
        lambda part: tree.nearest_to(rows[part], NORMAL_NEIGHBOURS), len(rows), cloud, min(NORMAL_NEIGHBOURS, tree.size)
    )


def _fit_near(
    nearest: Callable[[slice], tuple[IntArray, FloatArray]], total: int, cloud: FloatArray, count: int
) -> PlaneFits:
    parts, gaps = [], [np.zeros(0)]
    for i in range(0, total, CHUNK_POINTS):
        indices, distances = nearest(slice(i, i + CHUNK_POINTS))
        parts.append(_fit_chunk(cloud, indices))
        gaps.append(distances[:, :2][:, -1])
    neighbours = indices if len(parts) == 1 else None
    return replaced(_joined(parts, count), gaps=np.concatenate(gaps), neighbours=neighbours)


def fit_planes_around(
    tree: NeighbourTree, cloud: FloatArray, rows: IntArray, count: int = NORMAL_NEIGHBOURS
) -> PlaneFits:
    """Fit planes at points of the cloud itself, from the neighbours that its tree remembers."""
    parts = []
    for i in range(0, len(rows), CHUNK_POINTS):
        indices, _ = tree.around(rows[i : i + CHUNK_POINTS])
        parts.append(_fit_chunk(cloud, np.ascontiguousarray(indices[:, :count], dtype=np.int64)))
    return _joined(parts, min(count, tree.size))


def fit_planes_among(cloud: FloatArray, indices: IntArray) -> PlaneFits:
    """Fit planes to points of a cloud, (n, k) rows of it."""
    return _joined([_fit_chunk(cloud, indices)], indices.shape[1])


def _joined(parts: list[tuple[FloatArray, FloatArray, FloatArray]], count: int) -> PlaneFits:
    if not parts:
        return PlaneFits(np.zeros((0, 3)), np.zeros(0), np.zeros(0), count)
    normals, residuals, lever = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return PlaneFits(normals, residuals, lever, count)


def _fit_chunk(cloud: FloatArray, indices: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    from dqreg.kernels.clouds.plane_fits import fit_plane_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    total, k = indices.shape
    normals, residuals, lever = np.full((total, 3), np.nan), np.full(total, np.nan), np.zeros(total)
    if k >= MIN_NEIGHBOURS:
        over_chunks(fit_plane_rows, total, as_plain(cloud), indices, normals, residuals, lever, chunk=CHUNK_PLANES)
    return normals, residuals, lever


def fit_wide_planes(tree: NeighbourTree, cloud: FloatArray, rows: IntArray, noise: float, within: float) -> PlaneFits:
    """Fit the planes that most of many neighbours of some points of the tree, (m,) rows, lie in within a distance.

    There is none where what it holds lies along a line, but for noise.
    """
    neighbours, _ = tree.nearest_to(rows, WIDE_NEIGHBOURS)
    tried = np.arange(0, neighbours.shape[1], TRIED_STEP)
    neighbours = np.hstack([neighbours[:, tried], np.delete(neighbours, tried, axis=1)])
    normals, _, found = fit_edge_planes(cloud, neighbours, within, len(tried) - 1)
    arms = np.take(cloud, neighbours, axis=0) - cloud[rows, None]
    heights = np.einsum("ijk,ik->ij", arms, normals)
    held = np.abs(heights) <= within
    middles = (held * heights).sum(axis=1) / np.maximum(held.sum(axis=1), 1)
    held = np.abs(heights - middles[:, None]) <= within
    count = held.sum(axis=1)
    arms -= (np.einsum("ij,ijk->ik", held, arms) / np.maximum(count, 1)[:, None])[:, None]
    scatters = np.einsum("ij,ijk,ijl->ikl", held, arms, arms)
    squares, axes = np.linalg.eigh(scatters)
    least, small, large = squares.T
    fewest = max(MIN_HELD_NEIGHBOURS, WIDE_SHARE * neighbours.shape[1])
    known = found & held[:, 0] & (count >= fewest) & (small > MIN_SPREAD_RATIO * noise**2 * count)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Of as many neighbours as others are of, that hold their normals as well.
        levers = np.where(known, 1.0 / (1.0 / small + 1.0 / large) / NORMAL_NEIGHBOURS, 0.0)
    residuals = np.sqrt(np.maximum(least, 0.0) / np.maximum(count - 3, 1))
    return PlaneFits(np.where(known[:, None], axes[:, :, 0], np.nan), residuals, levers, NORMAL_NEIGHBOURS)


def fit_edge_planes(
    cloud: FloatArray, indices: IntArray, within: float, nearest: int = TRIED_NEIGHBOURS
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Unit normals and residuals (see `PlaneFits`) of the planes that most of the neighbours lie in; and which are any.

    Where neighbours are of several faces a least-squares plane is of none: it lies across the edge. Here those within a
    distance of a plane through the point and two of the nearest are counted, and the rest costs no more the farther it
    is away.

    Shapes: indices (n, k) rows of the cloud, the point itself first; returns (n, 3), (n,), (n,).
    """
    from dqreg.kernels.clouds.edge_planes import edge_plane_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    total = len(indices)
    normals, residuals, found = np.zeros((total, 3)), np.zeros(total), np.zeros(total, dtype=bool)
    limits = nearest, MIN_APART_SIN, float(within), HELD_ROUNDS, MIN_HELD_NEIGHBOURS
    over_chunks(
        edge_plane_rows,
        total,
        as_plain(cloud),
        np.ascontiguousarray(indices),
        *limits,
        normals,
        residuals,
        found,
        chunk=CHUNK_EDGE_PLANES,
    )
    return normals, residuals, found


def orient_towards(normals: FloatArray, points: FloatArray, viewpoint: FloatArray) -> FloatArray:
    """Normals flipped towards the sensor."""
    facing = np.einsum("ij,ij->i", viewpoint - points, normals)
    return np.where((facing < 0.0)[:, None], -normals, normals)


@dataclasses.dataclass(frozen=True)
class ScanPlanes:
    """Planes at m of so many points of a scan: kept for these, and written out for all where all are asked about."""

    rows: IntArray  # (m,): Those points, ascending
    normals: FloatArray  # (m, 3): Zero where there is no plane
    levers: FloatArray  # (m,): Zero where there is no plane
    residuals: FloatArray  # (m,)
    total: int  # Points

    @staticmethod
    def of(rows: IntArray, fits: PlaneFits, total: int) -> ScanPlanes:
        """Planes as they were fitted."""
        known = fits.known
        normals, levers = np.where(known[:, None], fits.normals, 0.0), np.where(known, fits.lever, 0.0)
        return ScanPlanes(rows, normals, levers, fits.residuals.copy(), total)

    def oriented(self, points: FloatArray, viewpoint: FloatArray) -> ScanPlanes:
        """The same with normals that face a viewpoint, of all points."""
        return replaced(self, normals=orient_towards(self.normals, points[self.rows], viewpoint))

    def at(self, rows: IntArray) -> ScanPlanes:
        """Those at some rows, ascending, counted among these."""
        if rows is self.rows:
            return ScanPlanes(np.arange(len(rows)), self.normals, self.levers, self.residuals, len(rows))
        # The fewer are looked up among the more.
        if len(rows) > len(self.rows):
            at = np.minimum(np.searchsorted(rows, self.rows), len(rows) - 1)
            places = np.flatnonzero(rows[at] == self.rows)
            fitted = at[places]
        else:
            at = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
            fitted = np.flatnonzero(self.rows[at] == rows)
            places = at[fitted]
        normals = np.take(self.normals, places, axis=0)
        return ScanPlanes(fitted, normals, self.levers[places], self.residuals[places], len(rows))

    def whole(self, name: str) -> FloatArray:
        """A column of all points: those without a plane have zeros, and NaN as their residual."""
        column: FloatArray = getattr(self, name)
        shape = self.total, *column.shape[1:]
        whole = np.full(shape, np.nan) if name == "residuals" else np.zeros(shape)
        whole[self.rows] = column
        return whole


def sample_rows(total: int, wanted: int) -> IntArray:
    """Evenly spread row numbers: with points in Morton order, an even thinning in space.

    Shapes: returns (total, wanted).
    """
    if wanted >= total:
        return np.arange(total)
    # What `np.linspace` comes to, in a third of its time.
    rows = np.arange(wanted) * ((total - 1) / max(wanted - 1, 1))
    rows[1:][-1:] = total - 1
    rounded: IntArray = np.rint(rows).astype(np.int64)
    return rounded
