"""Motions that put the planes of a scan into other planes of its target: steps of stairs, corners of a block.

Three planes fix a pose. Where a scan shows hardly more than planes, each pose that puts them into planes of the target
may explain it as well; the heights of the planes tell which, before any point is asked.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import cross, nonzero_rows

# Points that are looked at, and the share of them that a plane holds at least.
PLANE_POINTS, MIN_PLANE_SHARE = 800, 0.015
# Directions, and planes along each.
MAX_DIRECTIONS, MAX_PLANES = 5, 16
SAME_DIRECTION_RAD = np.deg2rad(10.0)
SAME_DIRECTION_COS = np.cos(SAME_DIRECTION_RAD)
# Normals that are tried as a direction.
TRIED_NORMALS = 100
# Heights of one plane, and of planes that are laid in each other.
PLANE_THICKNESS_DIAGONALS, SAME_PLANE_DIAGONALS = 0.01, 0.012
# Share of the points that the planes hold, below which they say nothing of the rest; share of them that a motion may
# put into no plane, or beyond the ends of the target.
MIN_FLAT_SHARE, MAX_LOST_SHARE = 0.7, 0.15
# Shifts along a direction that are combined, and motions that are kept.
MAX_SHIFTS, MAX_MAPS = 5, 60
# What moves the scan by less is none.
UNMOVED_DIAGONALS = 0.02
# Axes whose smallest singular value is less fix no shift.
MIN_SINGULAR_VALUE = 0.3
# Points beyond the ends of the heights.
BEYOND_SHARE = 0.01


# Shifts of planes along one direction into those along another, and what they lose: by both directions, and the sign.
Laid = dict[tuple[int, int, float], tuple[FloatArray, FloatArray]]


@dataclasses.dataclass(frozen=True, eq=False)
class Planes:
    """Planes of a shape by their directions, of which the first holds most points."""

    directions: FloatArray  # (k, 3): Unit normals of either sign
    heights: tuple[FloatArray, ...]  # Of the planes along each direction
    shares: tuple[FloatArray, ...]  # Of all points that each plane holds
    points: FloatArray  # (n, 3)

    @staticmethod
    def of(points: FloatArray, normals: FloatArray, size: float) -> Planes:
        """Planes of points on a shape of a size, with normals of either sign, zero where unknown, (n, 3)."""
        rows = sample_rows(len(points), PLANE_POINTS)
        points, normals = points[rows], np.nan_to_num(normals[rows])
        least = MIN_PLANE_SHARE * len(points)
        left: BoolArray = nonzero_rows(normals)
        directions, heights, shares = [], [], []
        for _ in range(MAX_DIRECTIONS):
            few = np.flatnonzero(left)
            if len(few) <= least:
                break
            alike = np.abs(normals[few] @ normals[few[sample_rows(len(few), TRIED_NORMALS)]].T) > SAME_DIRECTION_COS
            held = few[alike[:, int(alike.sum(axis=0).argmax())]]
            left[held] = False
            # The mean of either sign.
            direction = np.linalg.eigh(normals[held].T @ normals[held])[1][:, 2]
            found = _clusters(points[held] @ direction, PLANE_THICKNESS_DIAGONALS * size, least)
            if found:
                directions.append(direction)
                heights.append(np.array([height for height, _ in found]))
                shares.append(np.array([count for _, count in found]) / len(points))
        return Planes(np.array(directions).reshape(-1, 3), tuple(heights), tuple(shares), points)

    def beside(self, target: Planes) -> Planes:
        """A single plane with a direction across it that it has no plane along: that of most points of a target."""
        if len(self.directions) != 1 or not len(target.directions):
            return self
        across = np.linalg.norm(np.cross(target.directions, self.directions[0]), axis=1)
        k = int((across * [share.sum() for share in target.shares]).argmax())
        other = target.directions[k] - (target.directions[k] @ self.directions[0]) * self.directions[0]
        if across[k] < MIN_SINGULAR_VALUE:
            return self
        directions = np.stack([self.directions[0], other / np.linalg.norm(other)])
        return Planes(directions, (*self.heights, np.zeros(0)), (*self.shares, np.zeros(0)), self.points)

    @property
    def flat(self) -> float:
        """Share of the points that lie in the planes."""
        return float(sum(share.sum() for share in self.shares))


def plane_maps(scan: Planes, target: Planes, size: float, *, reaching: FloatArray | None = None) -> FloatArray:
    """Motions that put the planes of a scan at its pose into others of a target, (k, 4, 4).

    What planes along two directions leave open, the ends of both may close, given points, (n, 3), of those of the scan.
    """
    if scan.flat < MIN_FLAT_SHARE or min(len(scan.directions), len(target.directions)) < 2:
        return np.zeros((0, 4, 4))
    ends = [_ends(target.points @ axis, SAME_PLANE_DIAGONALS * size) for axis in target.directions]
    laid: Laid = {}
    found = [
        lost_and_map
        for R in _rotations(scan, target)
        for lost_and_map in _shifted(R, scan, target, ends, SAME_PLANE_DIAGONALS * size, laid, reaching)
    ]
    middle = scan.points.mean(axis=0)
    found.sort(key=lambda pair: pair[0])
    maps = np.array([T for _, T in found]).reshape(-1, 4, 4)
    turned = np.trace(maps[:, :3, :3], axis1=1, axis2=2) < 1.0 + 2.0 * SAME_DIRECTION_COS
    shifted = np.linalg.norm(maps[:, :3, :3] @ middle + maps[:, :3, 3] - middle, axis=1) > UNMOVED_DIAGONALS * size
    return np.asarray(maps[turned | shifted][:MAX_MAPS])


def _clusters(heights: FloatArray, thick: float, least: float) -> list[tuple[float, int]]:
    """Middle and count of points of the planes, the fullest first."""
    heights = np.sort(heights)
    found: list[tuple[float, int]] = []
    while len(found) < MAX_PLANES and len(heights):
        counts = np.searchsorted(heights, heights + thick) - np.arange(len(heights))
        best = int(counts.argmax())
        if counts[best] < least:
            break
        held = slice(best, best + int(counts[best]))
        found.append((float(heights[held].mean()), int(counts[best])))
        heights = np.delete(heights, held)
    return found


def _ends(heights: FloatArray, within: float) -> tuple[float, float]:
    """Heights between which a target reaches, and what lies about in them."""
    heights = np.sort(heights)
    beyond = int(BEYOND_SHARE * len(heights))
    return float(heights[beyond]) - within, float(heights[-1 - beyond]) + within


def _rotations(scan: Planes, target: Planes) -> list[FloatArray]:
    """Rotations that lay the two largest directions of one shape along two of another."""
    one = scan.directions[0]
    across = np.linalg.norm(np.cross(scan.directions, one), axis=1)
    held = np.maximum([share.sum() for share in scan.shares], np.finfo(float).tiny)
    other = scan.directions[int((across * held).argmax())]
    back = _frame(one, other).T
    angles = np.arccos(np.clip(target.directions @ target.directions.T, -1.0, 1.0))
    least, found = np.arccos(np.clip(one @ other, -1.0, 1.0)), []
    for first, second in itertools.permutations(range(len(target.directions)), 2):
        for sign, angle in ((1.0, angles[first, second]), (-1.0, np.pi - angles[first, second])):
            if abs(angle - least) > SAME_DIRECTION_RAD:
                continue
            axes = _frame(target.directions[first], sign * target.directions[second])
            # Both directions turned over leave what is across them.
            found += [axes @ back, axes * [-1.0, -1.0, 1.0] @ back]
    return found


def _frame(one: FloatArray, other: FloatArray) -> FloatArray:
    """Orthonormal axes, the columns: a direction, what is across it of another one, and what is across both."""
    other = other - (other @ one) * one
    other = other / np.linalg.norm(other)
    return np.column_stack([one, other, cross(one, other)])


def _shifted(
    R: FloatArray,
    scan: Planes,
    target: Planes,
    ends: Sequence[tuple[float, float]],
    within: float,
    laid: Laid,
    reaching: FloatArray | None,
) -> list[tuple[float, FloatArray]]:
    """A rotation with each shift that loses few points of the scan, after the share of those.

    What planes along one direction lose in those along another is the same for many rotations, and is kept.
    """
    axes: list[FloatArray] = []
    choices: list[list[tuple[float, float]]] = []
    missing, back = 0.0, target.directions @ R
    cosines = scan.directions @ back.T
    for k, m in enumerate(np.abs(cosines).argmax(axis=1)):
        if abs(cosines[k, m]) < SAME_DIRECTION_COS:
            missing += float(scan.shares[k].sum())
            continue
        axis = target.directions[m]
        if axes and _least_spread([*axes, axis]) < MIN_SINGULAR_VALUE:
            continue
        sign = float(np.sign(cosines[k, m]))
        if not len(scan.heights[k]):
            ends_of = [] if reaching is None else _between_ends(reaching @ back[m], target.points @ axis, within)
            choices.append(ends_of)
            axes.append(axis)
            if not ends_of:
                break
            continue
        if (k, int(m), sign) not in laid:
            laid[k, int(m), sign] = _laid(sign * scan.heights[k], scan.shares[k], target.heights[m], within)
        choices.append(_shifts(laid[k, int(m), sign], scan.points @ back[m], ends[m], within))
        if reaching is not None and len(axes) == 2:
            # Of its rims a sample of the target may hold too few points for a plane.
            choices[-1] += _between_ends(reaching @ back[m], target.points @ axis, within)
        axes.append(axis)
        if len(axes) == 3 or not choices[-1] or missing > MAX_LOST_SHARE:
            break
    is_fixed = len(axes) == 3 or (len(axes) == 2 and np.trace(R) > 1.0 + 2.0 * SAME_DIRECTION_COS)
    if not is_fixed and reaching is not None and len(axes) == 2 and all(choices):
        axes.append(third := cross(*axes))
        choices.append(_between_ends(reaching @ (third @ R), target.points @ third, within))
        is_fixed = True
    return _combined(R, axes, choices, missing) if is_fixed else []


def _least_spread(axes: Sequence[FloatArray]) -> float:
    """Smallest singular value of two or three unit vectors."""
    if len(axes) == 2:
        return math.sqrt(max(1.0 - abs(float(axes[0] @ axes[1])), 0.0))
    return float(np.linalg.svd(np.array(axes), compute_uv=False)[-1])


def _laid(heights: FloatArray, shares: FloatArray, theirs: FloatArray, within: float) -> tuple[FloatArray, FloatArray]:
    """Shifts that lay one of some planes in one of others and lose few points in no plane, and the share of those."""
    shifts = (theirs[:, None] - heights).ravel()
    apart = np.abs(heights[:, None] + shifts[:, None, None] - theirs).min(axis=2) > within
    lost = apart @ shares
    few = lost <= MAX_LOST_SHARE
    return shifts[few], lost[few]


def _shifts(
    laid: tuple[FloatArray, FloatArray], along: FloatArray, ends: tuple[float, float], within: float
) -> list[tuple[float, float]]:
    """Share of the points that each shift along a direction loses, and the shift; the best ones."""
    shifts, lost = laid
    if not len(shifts):
        return []
    low, high = ends[0] - shifts[:, None], ends[1] - shifts[:, None]
    beyond = 1.0 - np.count_nonzero((along >= low) & (along < high), axis=1) / len(along)
    lost = np.maximum(lost, beyond)
    kept: list[tuple[float, float]] = []
    for k in np.argsort(lost, kind="stable"):
        if lost[k] > MAX_LOST_SHARE or len(kept) == MAX_SHIFTS:
            break
        if all(abs(shifts[k] - shift) > within for _, shift in kept):
            kept.append((float(lost[k]), float(shifts[k])))
    return kept


def _between_ends(along: FloatArray, theirs: FloatArray, within: float) -> list[tuple[float, float]]:
    """Shifts that lay the ends of a scan on those of its target, and its middle between them, as above."""
    first, last = theirs.min() - along.min(), theirs.max() - along.max()
    if last - first < -2.0 * within:
        return []
    shifts = [0.5 * (first + last)] + ([first, last] if last - first > within else [])
    return [(0.0, float(shift)) for shift in shifts]


def _combined(
    R: FloatArray, axes: Sequence[FloatArray], choices: Sequence[list[tuple[float, float]]], missing: float
) -> list[tuple[float, FloatArray]]:
    """All combinations of shifts along the axes that lose few points together."""
    shifts = [(missing + sum(share for share, _ in some), some) for some in itertools.product(*choices)]
    few = [(lost, [shift for _, shift in some]) for lost, some in shifts if lost <= MAX_LOST_SHARE]
    if not few:
        return []
    found, back = [], np.linalg.pinv(np.array(axes))
    for lost, shift in few:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, back @ shift
        found.append((lost, T))
    return found
