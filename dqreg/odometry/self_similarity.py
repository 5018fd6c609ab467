"""Shifts of a frame onto itself: in a hall of equal columns it fits as well one period on, in any direction.

What stands on the floor is looked at from above, in the plane across the direction that most faces have: a frame that
comes to lie on itself somewhere else lies as well on a map of the same place there.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Scan
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.rigid import pose
from dqreg.trust.free_space import DepthImage

# Cells to a side at most; cosine of a normal with the common direction below which a point is of what stands.
MAX_IMAGE_CELLS, STANDING_COS = 256, 0.5
# Least share of what stands that must meet known ground, and that must come to lie on what stands.
MIN_COMMON_SHARE, MIN_SIMILAR_SHARE = 0.3, 0.7
# Translations that are kept.
MAX_SHIFTS = 12
# Cells around a shift within which none is more similar.
SUPPRESSION_CELLS = 2


# A face across a shift blocks the way where it holds this share of the points; cosine of its normal with the shift.
BLOCKING_SHARE, ACROSS_COS = 0.1, 0.9

# Share of the points of faces across a step that are seen alike from both of its ends, and their number, at least.
MIN_ALIKE_SHARE, MIN_ALIKE_POINTS = 0.1, 40
# What of it stands where the frame looked through at most, before the pose is refined and after. Halls of equal columns
# came to 0.15 and 0.04, furnished ones to 0.09 of the latter and more.
ROUGH_SHARE, CONTRADICTED_SHARE = 0.2, 0.05
# Frames of so nearly as many points, one a voxel, are as far apart in the image.
SAME_COUNT_SHARE = 0.1
# Cosine of a normal with a step whose face is across it; blur of a line of sight over the step.
FACING_COS, MAX_BLUR_STEPS = 0.5, 0.5
# Pixels by which a line of sight may be off: the nearest range around each one counts.
SIGHT_LINE_PIXELS = 1.5


def _are_upright(normals: FloatArray, axes: FloatArray) -> BoolArray:
    """Points of faces across the one that is most common, (n,): what lies in that one fits everywhere."""
    return np.asarray((np.abs(normals @ axes[:, 2]) < STANDING_COS) & nonzero_rows(normals))


def behind_faces(points: FloatArray, normals: FloatArray, shift: FloatArray) -> bool:
    """Whether a floor, a ceiling or a wall lies between the sensor and a place: no frame gets there in a step."""
    length = float(np.linalg.norm(shift))
    along, faces = points @ shift / length, np.abs(normals @ shift) > ACROSS_COS * length
    return bool(np.mean(faces & (along > 0.0) & (along < length)) >= BLOCKING_SHARE)


def _axes(normals: FloatArray) -> FloatArray:
    """Directions of the normals, the most common last, in columns."""
    return np.asarray(np.linalg.eigh(normals.T @ normals)[1])


def self_similar_shifts(points: FloatArray, normals: FloatArray, cell: float, least: float) -> FloatArray:
    """Shifts, longer than the least, that put most of what stands in a frame onto what stands in it, (k, 3).

    The most similar first. Shapes: points, normals (n, 3), zero where none is known.
    """
    axes = _axes(normals)
    stands, plane = _are_upright(normals, axes), axes[:, :2]
    if not stands.any():
        return np.zeros((0, 3))
    flat = np.ascontiguousarray((points @ plane).T)
    low, high = flat.min(axis=1), flat.max(axis=1)
    cell = max(cell, float((high - low).max()) / MAX_IMAGE_CELLS)
    rows, columns = ((flat - low[:, None]) / cell).astype(np.int64)
    known = np.zeros((rows.max() + 1, columns.max() + 1), dtype=bool)
    occupied = np.zeros_like(known)
    known[rows, columns] = True
    occupied[rows[stands], columns[stands]] = True
    share, steps, lowest = _similar(occupied, known)
    shifts = (steps + lowest) * cell
    kept = np.flatnonzero(np.hypot(*shifts.T) > least)
    if not len(kept):
        return np.zeros((0, 3))
    kept = kept[_is_peak(share, steps[kept])]
    kept = kept[np.argsort(-share[tuple(steps[kept].T + SUPPRESSION_CELLS)], kind="stable")]
    found: list[int] = []
    while len(kept) and len(found) < MAX_SHIFTS:
        # Of equal ones side by side one is enough.
        found.append(int(kept[0]))
        kept = kept[(np.abs(steps[kept] - steps[kept[0]]) > SUPPRESSION_CELLS).any(axis=1)]
    return np.asarray(shifts[found] @ plane.T)


def _similar(occupied: BoolArray, known: BoolArray) -> tuple[FloatArray, IntArray, IntArray]:
    """How much of what comes to lie on known ground lies on what is occupied, or beside it, shift by shift.

    Zero where either is too little. Shapes: (h, w) by shifts in cells from the lowest on, in a frame of
    `SUPPRESSION_CELLS` zeros, (m, 2) where it is not zero, and (2,) the lowest shift.
    """
    from dqreg.kernels.maps.shift_counts import count_at_shifts, count_on_runs, runs_around
    from dqreg.kernels.threads import over_chunks

    cells = np.column_stack(np.divmod(np.flatnonzero(occupied), occupied.shape[1]))
    enough = MIN_COMMON_SHARE * len(cells)
    # As far as that many cells stay within.
    ordered = np.sort(cells, axis=0)
    up, down = occupied.shape - ordered[int(np.ceil(enough)) - 1], ordered[-int(np.ceil(enough))]
    counts = np.zeros(up + down + (1, 2), dtype=np.int32)
    count_on_runs(cells, runs_around(occupied), -down, counts)
    # Ground is counted where enough is met of the least that it may be.
    # The last column is none: zeros. Along two axes NumPy takes four times as long.
    steps = np.column_stack(np.divmod(np.flatnonzero(counts >= MIN_SIMILAR_SHARE * enough), counts.shape[1]))
    met, ground = counts[tuple(steps.T)], np.zeros(len(steps), dtype=np.int32)
    over_chunks(count_at_shifts, len(steps), steps - down, cells, _widened(np.pad(known, (0, 1))), ground)
    alike = (ground >= enough) & (met >= MIN_SIMILAR_SHARE * ground)
    share = np.zeros(up + down + 1 + 2 * SUPPRESSION_CELLS)
    share[tuple(steps[alike].T + SUPPRESSION_CELLS)] = met[alike] / ground[alike]
    return share, steps[alike], -down


def _widened(grid: BoolArray) -> BoolArray:
    """Cells that hold something, and those around them."""
    for axis in (0, 1):
        wide = grid.copy()
        here, there = (np.moveaxis(each, axis, 0) for each in (grid, wide))
        there[1:] |= here[:-1]
        there[:-1] |= here[1:]
        grid = wide
    return grid


def _is_peak(share: FloatArray, cells: IntArray) -> BoolArray:
    """Whether nothing around some cells of a framed grid, (n, 2), holds more than they do, (n,)."""
    here, peak = share[tuple(cells.T + SUPPRESSION_CELLS)], np.ones(len(cells), dtype=bool)
    for step in np.ndindex(2 * SUPPRESSION_CELLS + 1, 2 * SUPPRESSION_CELLS + 1):
        peak &= here >= share[tuple((cells + step).T)]
    return peak


@dataclasses.dataclass(frozen=True)
class FrameView:
    """What the scanner saw."""

    image: DepthImage
    margin: float
    measured: int = 0  # Points of the frame of which the pixel was measured

    @staticmethod
    def of(points: FloatArray, margin: float, before: FrameView | None = None) -> FrameView:
        """From the points of a frame, (n, 3); their spacing is that of a frame before with about as many."""
        count = len(points)
        if before is None or abs(count - before.measured) > SAME_COUNT_SHARE * before.measured:
            return FrameView(DepthImage.of(points, np.zeros(3)), margin, count)
        return FrameView(DepthImage.of(points, np.zeros(3), before.image.pixel), margin, before.measured)

    def compared(self, points: FloatArray, T: FloatArray) -> tuple[int, int]:
        """Points, moved, that stand where the frame looked through, and those about where it saw something."""
        return self.image.compared(pose.apply(T, points), self.margin, SIGHT_LINE_PIXELS)

    def repeats(self, scan: Scan, step: FloatArray, most: float) -> bool:
        """Whether a frame at the end of a step would see what it sees here, and no more than a share contradicts."""
        length = np.linalg.norm(step[:3, 3])
        # Of the points that the step takes out of their face, and farther than lines of sight are apart there.
        blur = self.margin + SIGHT_LINE_PIXELS * self.image.pixel * np.linalg.norm(scan.points, axis=1)
        points = scan.points[
            (np.abs(scan.normals @ step[:3, 3]) > FACING_COS * length) & (blur < MAX_BLUR_STEPS * length)
        ]
        through = whole = 0
        for T in (step, pose.inverse(step)):
            nearer, alike = self.compared(points, T)
            if alike < max(MIN_ALIKE_SHARE * len(points), MIN_ALIKE_POINTS):
                return False
            through, whole = through + nearer, whole + nearer + alike
        return through <= most * whole
