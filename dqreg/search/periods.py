"""Periods of a part: translations that put it onto itself but for its ends, as a step does with stairs.

They are found from the part alone: differences of points with equal normals crowd at them. A scan of the middle fits as
well one period on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, Surface, sample_mesh
from dqreg.rigid import pose
from dqreg.search.features import rarity
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refine

# Points that are drawn, rare directions as likely as common ones, and those of them whose differences are counted.
DRAWN_POINTS, COUNTED_POINTS = 6_000, 1_000
# Normals that are equal.
EQUAL_NORMAL_COS = 0.95
# Shortest and longest period, in sizes.
MIN_PERIOD_DIAGONALS, MAX_PERIOD_DIAGONALS = 0.04, 0.6
# Edge of the cells in which differences are counted, in sizes.
CELL_DIAGONALS = 1.0 / 60.0
# A peak of the counts stands out of the cells around it by so many standard deviations; so many are looked at, the
# densest first.
PEAK_SIGMAS, MAX_PEAKS = 12.0, 16
# Points that screen and check, and the refinement between: each asks about what the one before leaves.
SCREENING_POINTS, CHECKING_POINTS = 100, 400
REFINEMENT = Refinement(first=0.012, last=2e-3, steps=4, points=200)
# Distances within which points are in place, before and after the refinement, in sizes.
SCREENING_DISTANCE_DIAGONALS, CHECKING_DISTANCE_DIAGONALS = 0.01, 3e-3
# A translation is a period where this fraction of the part comes into place; less by few points, before the refinement.
MIN_FRACTION_IN_PLACE, MIN_SCREENED_FRACTION = 0.25, 0.15
# It beats translations a little shorter and longer by so much of that fraction; those differ by this, in sizes.
MIN_PEAK_CONTRAST = 0.08
NEIGHBOUR_DIAGONALS = 0.03
# A peak may be a multiple of a period: parts of it that are tried.
PERIOD_DIVISORS = (1, 2, 3)
# Shortest periods that are kept.
MAX_PERIODS = 6
# A translation is a multiple of a shorter one within this share of it.
MULTIPLE_TOLERANCE = 0.1
# Distinct translations that are refined at most.
MAX_REFINED = 16


# Points farther off than that are not looked for: a little more than what counts, which is within it.
SEARCH_MARGIN = 1.01
# The grid of differences: cells a side, with room for those around the longest ones; steps of a row number along each
# axis; and the row of no difference.
GRID_CELLS = 2 * (round(MAX_PERIOD_DIAGONALS / CELL_DIAGONALS) + 4) + 1
ROW_STRIDES = np.array([GRID_CELLS**2, GRID_CELLS, 1])
ZERO_ROW = GRID_CELLS**3 // 2


def near_periods(mesh: Mesh, surface: Surface, counted: int = COUNTED_POINTS) -> FloatArray:
    """Periods of a part, either way: near translations that put most of what it has of them onto itself, (k, 4, 4).

    The differences of so many points are counted.
    """
    rng = np.random.default_rng(0)
    sample = sample_mesh(mesh, DRAWN_POINTS, rng)
    points, normals = sample.points, np.asarray(sample.normals)
    weights = rarity(normals)
    rows = rng.choice(len(points), counted, replace=False, p=weights / weights.sum())
    shifts = _crowded(points[rows], normals[rows], surface.diagonal)
    if not len(shifts):
        return np.zeros((0, 4, 4))
    few, some, checks = (
        OrientedPoints.on_faces(points[rows[:k]], normals[rows[:k]])
        for k in (SCREENING_POINTS, REFINEMENT.points, CHECKING_POINTS)
    )
    shifts = np.concatenate([shifts / k for k in PERIOD_DIVISORS])
    shifts = shifts[np.linalg.norm(shifts, axis=1) >= MIN_PERIOD_DIAGONALS * surface.diagonal]
    poses = Poses(np.tile(np.eye(3), (len(shifts), 1, 1)), shifts)
    poses = poses[np.flatnonzero(_in_place(poses, few, surface, SCREENING_DISTANCE_DIAGONALS) >= MIN_SCREENED_FRACTION)]
    poses = poses[poses.distinct(np.zeros(3), np.pi, CELL_DIAGONALS * surface.diagonal, MAX_REFINED)]
    poses = refine(poses, some, surface, REFINEMENT.widths(surface.diagonal))
    poses = poses[_periodic(poses, checks, surface)]
    kept = poses[_shortest(poses.t)].matrices
    return np.concatenate([kept, [pose.inverse(T) for T in kept]]) if len(kept) else kept


def _crowded(points: FloatArray, normals: FloatArray, size: float) -> FloatArray:
    """Middles of the cells where differences of points with equal normals crowd, (k, 3)."""
    from dqreg.kernels.search.pair_differences import pair_differences
    from dqreg.kernels.threads import as_plain

    # Either way: a period and its opposite are one, whichever side of a plane the first point is on. So the pairs are
    # taken one way, and what they fill is mirrored: a cell and its opposite change places in the grid.
    limits = np.array(
        [
            EQUAL_NORMAL_COS,
            (MIN_PERIOD_DIAGONALS * size) ** 2,
            (MAX_PERIOD_DIAGONALS * size) ** 2,
            CELL_DIAGONALS * size,
        ]
    )
    pairs, counts = (as_plain(points), as_plain(normals), limits, GRID_CELLS), np.zeros(GRID_CELLS**3, dtype=np.int32)
    pair_differences(*pairs, counts, np.zeros(0, dtype=bool), np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
    near = _box_sums(counts + counts[::-1])
    # What stands out holds so many at least; of few cells is asked what is around them.
    found = ZERO_ROW + 1 + np.flatnonzero(near[ZERO_ROW + 1 :] > PEAK_SIGMAS)
    # A box of nine cells a side is three of three.
    around = (near[found[:, None] + 3 * _cube(1)].sum(axis=1) - near[found]) * (27.0 / 702.0)
    found = found[near[found] - around > PEAK_SIGMAS * np.sqrt(np.maximum(around, 1.0))]
    found = found[near[found] == near[found[:, None] + _cube(2)].max(axis=1, initial=0)]
    found = found[np.argsort(-near[found], kind="stable")][:MAX_PEAKS]
    if not len(found):
        return np.zeros((0, 3))
    asked = np.zeros(GRID_CELLS**3, dtype=bool)
    cells = found[:, None] + _cube(1)
    asked[cells] = True
    most = int(counts[np.union1d(cells, 2 * ZERO_ROW - cells)].sum())
    differences, places = np.zeros((most, 3)), np.zeros(most, dtype=np.int64)
    pair_differences(*pairs, counts, asked, differences, places)
    return _middles(differences, places, found)


def _box_sums(counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Sums over a cell and those before and after it along each axis of the grid, whose rim is empty."""
    for stride in ROW_STRIDES:
        total = counts.copy()
        total[stride:] += counts[:-stride]
        total[:-stride] += counts[stride:]
        counts = total
    return counts


def _cube(reach: int) -> IntArray:
    """Steps from a cell of the grid to those around it, up to so many along each axis, and to itself."""
    steps = np.arange(-reach, reach + 1)
    return np.asarray((steps[:, None, None] * GRID_CELLS**2 + steps[:, None] * GRID_CELLS + steps).ravel())


def _middles(differences: FloatArray, cells: IntArray, found: IntArray) -> FloatArray:
    """Mean of the differences in each of some cells and those around it, either way, (k, 3)."""
    blocks = found[:, None] + _cube(1)
    asked = np.zeros(GRID_CELLS**3, dtype=bool)
    asked[blocks] = True
    ahead, back = asked[cells], asked[2 * ZERO_ROW - cells]
    either = np.concatenate([differences[ahead], -differences[back]])
    at = np.r_[cells[ahead], 2 * ZERO_ROW - cells[back]]
    middles = np.zeros((len(blocks), 3))
    asked[blocks] = False
    for k, block in enumerate(blocks):
        asked[block] = True
        middles[k] = either[asked[at]].mean(axis=0)
        asked[block] = False
    return middles


def _periodic(poses: Poses, checks: OrientedPoints, surface: Surface) -> IntArray:
    """Which shifts put enough into place that is out of place a little before and after."""
    rotated = np.trace(poses.R, axis1=1, axis2=2) < 1.0 + 2.0 * np.cos(2.0 * CELL_DIAGONALS)
    rows = np.flatnonzero(~rotated & (np.linalg.norm(poses.t, axis=1) >= MIN_PERIOD_DIAGONALS * surface.diagonal))
    if not len(rows):
        return rows
    R, t = poses.R[rows], poses.t[rows]
    aside = NEIGHBOUR_DIAGONALS * surface.diagonal * t / np.linalg.norm(t, axis=1, keepdims=True)
    there = _in_place(Poses(R, t), checks, surface, CHECKING_DISTANCE_DIAGONALS)
    fits = np.flatnonzero(there >= MIN_FRACTION_IN_PLACE)
    if not len(fits):
        return rows[fits]
    beside = (_in_place(Poses(R, t + k * aside)[fits], checks, surface, CHECKING_DISTANCE_DIAGONALS) for k in (1, -1))
    return rows[fits[there[fits] - np.maximum(*beside) >= MIN_PEAK_CONTRAST]]


def _in_place(poses: Poses, checks: OrientedPoints, surface: Surface, within: float) -> FloatArray:
    """Fraction of the points that each pose puts so near to the surface, in sizes, with an equal normal, (k,)."""
    found = surface.closest(poses.apply(checks.points).reshape(-1, 3), within=SEARCH_MARGIN * within * surface.diagonal)
    normals = found.normals.reshape(len(poses), len(checks), 3)
    equal = np.einsum("kni,ni->kn", normals, checks.directions) > EQUAL_NORMAL_COS
    near = found.distances.reshape(len(poses), len(checks)) <= within * surface.diagonal
    return np.asarray((equal & near).mean(axis=1))


def _shortest(shifts: FloatArray) -> IntArray:
    """Rows of the shortest ones, without their multiples."""
    kept: list[int] = []
    for k in np.argsort(np.linalg.norm(shifts, axis=1), kind="stable"):
        times = [float(shifts[k] @ shifts[j] / (shifts[j] @ shifts[j])) for j in kept]
        gaps = [
            np.linalg.norm(shifts[k] - round(n) * shifts[j]) / np.linalg.norm(shifts[j])
            for n, j in zip(times, kept, strict=True)
        ]
        if len(kept) < MAX_PERIODS and all(gap > MULTIPLE_TOLERANCE for gap in gaps):
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)
