"""Initial poses from pairs of oriented points: rare pairs of the scan, looked up among all pairs of the target.

Two oriented points fix a pose. The target's pairs are sorted by distance and angles; a pair of the scan that has few
counterparts there is discriminative, so rare ones go first. All hypotheses are solved at once.
"""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg.geometry import Mesh, PointCloud, Surface
from dqreg.kernels.kept import Kept
from dqreg.kernels.threads import NEVER, Later, deadline_here, unlocked_property
from dqreg.rigid.symmetry import Symmetry
from dqreg.search.features import even_points, target_features
from dqreg.search.grids import Edges, PlaneGrid, Rows
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.symmetry import find_symmetry

# Points of the target whose pairs are tabulated: their square is the table. They are drawn from so many.
TABLE_POINTS, DENSE_POINTS = 1_000, 20_000
# Bins: distance in sizes, angles in radians.
LENGTH_BIN, ANGLE_BIN = 0.02, 0.2
# Cosines of the angles at which bins end, up to a right one.
ANGLE_COSINES = np.cos(ANGLE_BIN * np.arange(1.0, 8.0))
# Numbers that a key may be: bins of lengths up to the size times eight of each angle.
KEY_COUNT = (round(1.0 / LENGTH_BIN) + 1) * 512
# Shorter pairs constrain the rotation badly; in sizes.
MIN_PAIR_DIAGONALS = 0.15
# Below this cosine between direction and line, the sign of the direction is uncertain: both are tried.
LEAST_COSINE = 0.15
# Pairs in which either direction stands at a smaller sine to the line constrain the rotation about it too little.
LEAST_SINE = 0.15
# Fitted normals of corresponding points differ by no more than this, signs aside.
NORMALS_RAD = 0.45
# Pairs drawn from the scan, pairs used of these, counterparts of each, at most.
DRAWN_PAIRS = 24_000
USED_PAIRS = 3_000
MAX_COUNTERPARTS = 30
# A pair with so many counterparts is common: how many more does not matter.
COMMON_COUNTERPARTS = np.iinfo(np.uint16).max
# Rows of the table whose pairs one thread finds in one go.
CHUNK_TABLE_ROWS = 32
# Draws at most where most pairs are too long, in multiples.
MAX_DRAW_ROUNDS = 12


@dataclasses.dataclass(frozen=True)
class PairTable:
    """All far-apart pairs of points of a target, sorted by key, and the grids for screening."""

    points: OrientedPoints  # On faces, then at edges
    # first, second: (n,): The pairs, rows of the points, in the order of their keys
    first: Rows
    second: Rows
    starts: IntArray  # (KEY_COUNT + 1,): First pair of each key, and how many there are: keys are looked up
    size: float  # Diagonal of the target
    grid: PlaneGrid  # Distances to the target, and its tangent planes
    edges: Edges | None  # Edges of the target, where there are any
    target: PointCloud | Mesh  # The target
    surface: Surface  # The same
    _symmetry: Kept[Symmetry | None] = dataclasses.field(repr=False, compare=False)

    @unlocked_property
    def symmetry(self) -> Symmetry | None:
        """Symmetries of a mesh, found when first asked for and kept; None for a cloud."""
        return self._symmetry.result()

    @staticmethod
    def of(target: PointCloud | Mesh, surface: Surface) -> PairTable:
        """Table of a target; the same target gives the same table."""
        even = even_points(target, surface, DENSE_POINTS)
        points, edges = target_features(target, even, TABLE_POINTS)
        # A target without a single normal has no oriented points, but it has a size.
        bare = target.vertices if isinstance(target, Mesh) else target.points
        low, high = bounds(points.points if len(points) else bare)
        # Neither asks the surface: another core is at it while this one does.
        beside = Later(
            lambda: (
                _pairs_by_key(points, surface.diagonal),
                Edges.of(edges, low, high, surface.diagonal) if len(edges) else None,
            )
        )
        grid = PlaneGrid(surface, even, low, high)
        (first, second, starts), known = beside.result()
        # A table that is made without a deadline is for other scans, too.
        symmetry = Kept(partial(_symmetry_of, target, surface, grid), for_others=deadline_here() == NEVER)
        return PairTable(points, first, second, starts, surface.diagonal, grid, known, target, surface, symmetry)


def _symmetry_of(target: PointCloud | Mesh, surface: Surface, grid: PlaneGrid) -> Symmetry | None:
    return find_symmetry(target, surface, grid) if isinstance(target, Mesh) else None


def _pairs_by_key(oriented: OrientedPoints, size: float) -> tuple[Rows, Rows, IntArray]:
    """Rows of all usable pairs by their keys, either of a pair first, and the first of each key."""
    from dqreg.kernels.search.pair_keys import all_pair_keys, key_starts, order_of_keys
    from dqreg.kernels.threads import as_plain, over_chunks

    count = len(oriented)
    keys = np.zeros((count, count), dtype=np.int32)
    columns = as_plain(oriented.points), as_plain(oriented.directions), *_bins(size), keys
    over_chunks(all_pair_keys, count, *columns, chunk=CHUNK_TABLE_ROWS)
    starts = np.zeros(KEY_COUNT + 1, dtype=np.int64)
    key_starts(keys, starts)
    first, second = np.zeros((2, starts[-1]), dtype=np.int32)
    order_of_keys(keys, starts.copy(), first, second)
    return first, second, starts


def _bins(size: float) -> tuple[float, FloatArray, FloatArray]:
    """Length of a bin, limits of lengths and of a cosine, and bounds of the bins of angles."""
    return LENGTH_BIN * size, np.array([MIN_PAIR_DIAGONALS * size, size, np.sqrt(1.0 - LEAST_SINE**2)]), ANGLE_COSINES


def pair_keys(oriented: OrientedPoints, i: IntArray, j: IntArray, size: float) -> tuple[IntArray, BoolArray]:
    """One number per pair, of its distance and three angles, binned and without signs; and whether it is usable."""
    from dqreg.kernels.search import pair_keys as kernels
    from dqreg.kernels.threads import as_plain, over_chunks

    keys = np.zeros(len(i), dtype=np.int64)
    points = as_plain(oriented.points), as_plain(oriented.directions)
    over_chunks(kernels.pair_keys, len(i), *points, i, j, *_bins(size), keys)
    return keys, keys >= 0


def pair_hypotheses(scan: OrientedPoints, table: PairTable, rng: np.random.Generator) -> Poses:
    """Poses that put pairs of the scan on their counterparts of the target."""
    i, j, keys = _draw_pairs(scan, table.size, rng)
    first, last = table.starts[keys], table.starts[keys + 1]
    counts = last - first
    known = np.flatnonzero(counts)
    rarity = np.minimum(counts[known], COMMON_COUNTERPARTS).astype(np.uint16)
    rare = known[np.argsort(rarity, kind="stable")[:USED_PAIRS]]
    taken = np.minimum(counts[rare], MAX_COUNTERPARTS)
    rows = np.repeat(rare, taken)
    # Evenly through the counterparts, from a drawn one on: no order of the table is preferred.
    step = np.arange(len(rows)) - np.repeat(np.cumsum(taken) - taken, taken)
    shift = np.repeat(rng.random(len(rare)), taken)
    counterpart = first[rows] + ((step + shift) * counts[rows] / np.repeat(taken, taken)).astype(np.int64)
    first, second = (np.take(side, counterpart).astype(np.int64) for side in (table.first, table.second))
    return _poses_of(scan, table.points, i[rows], j[rows], first, second)


def _poses_of(
    scan: OrientedPoints, known: OrientedPoints, i: IntArray, j: IntArray, first: IntArray, second: IntArray
) -> Poses:
    """Poses of pairs (i, j) on known pairs, both of whose directions agree; last those by an uncertain sign."""
    from dqreg.kernels.search.pair_poses import pair_poses
    from dqreg.kernels.threads import as_plain, over_chunks

    count = len(i)
    R, t, agree = np.zeros((2, count, 3, 3)), np.zeros((2, count, 3)), np.zeros((2, count), dtype=bool)
    source = as_plain(scan.points), as_plain(scan.directions), i, j
    target = as_plain(known.points), as_plain(known.directions), first, second
    limits = LEAST_COSINE, float(np.cos(NORMALS_RAD))
    over_chunks(pair_poses, count, *source, *target, *limits, R, t, agree)
    return Poses(R[agree], t[agree])


def _draw_pairs(scan: OrientedPoints, size: float, rng: np.random.Generator) -> tuple[IntArray, IntArray, IntArray]:
    found: list[tuple[IntArray, IntArray, IntArray]] = [(np.zeros(0, dtype=np.int64),) * 3]
    count = 0
    for _ in range(MAX_DRAW_ROUNDS):
        i, j = scan.draw(DRAWN_PAIRS, rng), scan.draw(DRAWN_PAIRS, rng)
        keys, usable = pair_keys(scan, i, j, size)
        found.append((i[usable], j[usable], keys[usable]))
        count += int(np.count_nonzero(usable))
        # A scene is much larger than the part: most of its pairs are too long.
        if 2 * count >= DRAWN_PAIRS or not len(i):
            break
    i, j, keys = (np.concatenate([part[k] for part in found]) for k in range(3))
    return i, j, keys
