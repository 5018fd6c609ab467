"""Patterns in the residuals: patches of points that deviate as a whole, and a strain of the whole scan.

A scan of few points does not know its own noise, so that its residuals alone cannot be called too large. A pattern in
them can be found all the same.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median, product
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.scan import Scan
from dqreg.solvers.quadratic import plane_rows
from dqreg.trust.robust_fit import unexplained
from dqreg.trust.strain import COMPONENTS

# Neighbouring points of a patch, and the kernel scales that its median may deviate: for 32 points of independent noise
# the median is good to a quarter of one.
PATCH_POINTS, PATCH_OFFSET_SIGMAS = 32, 2.0
# Kernel scales within which a point lies on a surface; real scans have longer tails than a Gaussian.
INLIER_SIGMAS = 4.0
# A point off the target whose neighbour of this rank is so many times as far as for points on it is an outlier.
ISOLATION_NEIGHBOUR, ISOLATION_RATIO = 5, 2.5
# Points on the target that tell what is usual, and the reach, in spacings, within which it may be settled sooner.
SPACING_SAMPLE, FIRST_REACH_SPACINGS = 250, 1.5
# A patch whose plane holds more points far from the target than so many times those near it belongs to an object that
# the part stands on or leans against.
BACKGROUND_RATIO = 1.0


def isolated(scan: Scan, on: BoolArray, whole: Scan | None = None) -> BoolArray:
    """Which points off the target have no neighbours as points of a surface have them, (n,): scattered outliers.

    They may be some points of a whole scan. Together they would look like patches that deviate, but they are no surface
    that could contradict the pose.
    """
    off, points = np.flatnonzero(~on), scan.points
    alone = np.zeros(len(points), dtype=bool)
    if len(off) and len(points) - len(off) > ISOLATION_NEIGHBOUR:
        some = np.flatnonzero(on)[sample_rows(len(points) - len(off), SPACING_SAMPLE)]
        if len(off) > len(some):
            # Of many it is only asked whether they are farther apart: the search ends there, whatever is rounded.
            limit = ISOLATION_RATIO * median(_gaps(scan, some, whole or scan))
            alone[off] = _gaps(scan, off, whole or scan, limit * (1.0 + 1e-9)) > limit
            return alone
        gaps = _gaps(scan, off, whole or scan)
        # Where more than half of the others have none nearer than this, it is no more than the usual one.
        reach = float(gaps.max()) / ISOLATION_RATIO * (1.0 + 1e-9)
        if reach <= FIRST_REACH_SPACINGS * scan.spacing:
            capped = _gaps(scan, some, whole or scan, reach)
            if 2 * np.count_nonzero(capped >= reach * (1.0 - 1e-12)) > len(some):
                return alone
        alone[off] = gaps > ISOLATION_RATIO * median(_gaps(scan, some, whole or scan))
    return alone


def _gaps(scan: Scan, rows: IntArray, whole: Scan, within: float = np.inf) -> FloatArray:
    """Distance of some points of a scan to their neighbour of the last rank in a whole one, (m,), or that distance."""
    # Both are in the order of one curve: as far along the whole stands the point itself, which is the first, or a
    # neighbour of it.
    along = rows * len(whole) // len(scan)
    return whole.tree.nearest_beside(scan.points[rows], along, ISOLATION_NEIGHBOUR + 1, within)[1][:, -1]


def patches_off(
    points: FloatArray, apart: FloatArray, aside: FloatArray, near: BoolArray, width: float
) -> tuple[BoolArray, BoolArray]:
    """Which patches are near the target and counted, and which of those deviate as a whole, (k,).

    An outlier leaves the median of its patch alone; a face in the wrong place moves it. So does a table that touches
    the part: patches whose plane continues far from the target are not counted.
    """
    count = len(points) // PATCH_POINTS
    if count == 0:
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    whole = slice(count * PATCH_POINTS)
    d, a = (x[whole].reshape(count, PATCH_POINTS) for x in (apart, aside))
    close = near[whole].reshape(count, PATCH_POINTS)
    # A median is off where half of its patch is at least: most patches need none.
    some = np.flatnonzero(
        (np.count_nonzero(np.abs(a) > PATCH_OFFSET_SIGMAS * width, axis=1) >= PATCH_POINTS // 2)
        | (np.count_nonzero(d > INLIER_SIGMAS * width, axis=1) >= PATCH_POINTS // 2)
    )
    off = np.zeros(count, dtype=bool)
    if len(some):
        off[some] = (np.abs(_medians(a[some])) > PATCH_OFFSET_SIGMAS * width) | (
            _medians(d[some]) > INLIER_SIGMAS * width
        )
    counted = 2 * np.count_nonzero(close, axis=1) >= PATCH_POINTS
    doubtful = np.flatnonzero(off & counted)
    if len(doubtful) and not near.all():
        patches = points[whole].reshape(count, PATCH_POINTS, 3)[doubtful]
        counted[doubtful[is_background(patches, points, near, ~near, width)]] = False
    return counted, off & counted


def _medians(rows: FloatArray) -> FloatArray:
    """Median of each row, of an even number of columns."""
    half = rows.shape[1] // 2
    return np.asarray(np.partition(rows, (half - 1, half), axis=1)[:, half - 1 : half + 1].mean(axis=1))


def is_background(patches: FloatArray, points: FloatArray, near: BoolArray, far: BoolArray, width: float) -> BoolArray:
    """Which patches lie in a plane that holds more points far from the target than near it, both (n,); (k,)."""
    # The median point and the flattest axis: some points of a patch may be of the part that stands on the table.
    middles = np.median(patches, axis=1)
    centred = patches - patches.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.matmul(centred.transpose(0, 2, 1), centred))[1][:, :, 0]
    heights = np.einsum("ki,ki->k", normals, middles)
    held = np.abs(product(normals, points.T) - heights[:, None]) <= INLIER_SIGMAS * width
    on_far, on_near = (np.count_nonzero(held & some, axis=1) for some in (far, near))
    return np.asarray(on_far > BACKGROUND_RATIO * on_near)


# Points off the target are of one feature where so many others that are off stand as near to each as so many points of
# the scan usually do, by this factor; fewer of them are chance.
FEATURE_NEIGHBOURS, FEATURE_REACH_RATIO = 4, 2.0
MIN_FEATURE_POINTS = 6


def share_together(points: FloatArray, off: BoolArray, counted: BoolArray) -> float:
    """Share of the counted points that are off the target together, as a displaced feature is and outliers are not.

    Shapes: points (n, 3) in the order of a space-filling curve, off and counted (n,).
    """
    together = off & counted
    if np.count_nonzero(together) <= max(FEATURE_NEIGHBOURS, MIN_FEATURE_POINTS):
        return 0.0
    apart, near = points[together], points[counted]
    some = near[sample_rows(len(near), SPACING_SAMPLE)]
    usual = median(NeighbourTree(near, in_order=True).nearest(some, FEATURE_NEIGHBOURS + 1)[1][:, -1])
    together = (
        NeighbourTree(apart, in_order=True).nearest(apart, FEATURE_NEIGHBOURS + 1)[1][:, -1]
        <= FEATURE_REACH_RATIO * usual
    )
    count = int(np.count_nonzero(together))
    return count / len(near) if count >= MIN_FEATURE_POINTS else 0.0


# Directions of faces that are told apart, and as many of them at most: those with most of the points.
DIRECTION_COS, MAX_DIRECTIONS = float(np.cos(np.deg2rad(8.0))), 12
# Heights within so many standard deviations of the noise either way are of one plane; so many points are in it,
LAYER_SIGMAS, MIN_LAYER_POINTS = 3.0, 12
# and so many times as many as in as wide a layer of those beside it, so many of them on each side.
LAYER_DENSITY_RATIO, LAYERS_BESIDE = 4.0, 2


def share_displaced(points: FloatArray, normals: FloatArray, off: BoolArray, noise: float) -> float:
    """Share of some points of a scan that lie off the target in planes parallel to its faces.

    Where points stand farther apart than a face is displaced, none of it looks like a surface by its neighbours:
    outliers are not told from it but by their heights, which scatter.

    Shapes: points (n, 3), normals of the target at them (n, 3), which are off it (n,).
    """
    if np.count_nonzero(off) < MIN_LAYER_POINTS:
        return 0.0
    left, found = points[off], 0
    for direction in _directions(normals[~off]):
        while (held := _fullest_layer(left @ direction, 2.0 * LAYER_SIGMAS * noise)) is not None:
            found, left = found + int(np.count_nonzero(held)), left[~held]
    return found / len(points)


def _fullest_layer(heights: FloatArray, width: float) -> BoolArray | None:
    """Which heights, (n,), are in the layer of a width that holds most; None where those beside it hold as many."""
    order = np.sort(heights)
    counts = np.searchsorted(order, order + width, side="right") - np.arange(len(order))
    if counts.max(initial=0) < MIN_LAYER_POINTS:
        return None
    low = order[counts.argmax()]
    high, margin = low + width, LAYERS_BESIDE * width
    beside = np.count_nonzero((heights >= low - margin) & (heights <= high + margin)) - counts.max()
    if counts.max() < LAYER_DENSITY_RATIO * beside / (2.0 * LAYERS_BESIDE):
        return None
    return np.asarray((heights >= low) & (heights <= high))


def _directions(normals: FloatArray) -> list[FloatArray]:
    """Directions of the faces that points lie on, the fullest first; opposite ones are one."""
    left = normals[np.linalg.norm(normals, axis=1) > 0.5]
    found: list[FloatArray] = []
    while len(left) >= MIN_LAYER_POINTS and len(found) < MAX_DIRECTIONS:
        alike = np.abs(product(left[:: max(1, len(left) // 50)], left.T)) > DIRECTION_COS
        held = alike[np.count_nonzero(alike, axis=1).argmax()]
        some = left[held]
        direction = some.T @ np.sign(some @ some[0])
        found.append(direction / np.linalg.norm(direction))
        left = left[~held]
    return found


# Chance that six strains explain as much of independent noise; F of good scans reaches 2.
CHANCE = 1e-6
# A smaller strain is no fault: parts shrink, and sensors are calibrated to one percent at worst.
LEAST = 0.02
# Fewer correspondences than these show no pattern: three for each of the twelve unknowns.
FEWEST = 3 * 12
# Correspondences this many median distances from a first fit are left out.
OUTSIDE = 4.5
# Eigenvalues below this fraction of the largest: a strain that the faces do not show.
UNOBSERVABLE = 1e-6


def stretch_of(
    points: FloatArray, normals: FloatArray, residuals: FloatArray, least: float = 0.0
) -> tuple[float, FloatArray]:
    """Strain of the scan against the target, fitted with the remaining motion: ``r = n . (w x p + v + E p)``.

    One that displaces the surface by less than a length, beyond what a motion explains, is none: no face shows it.
    """
    from scipy.special import fdtri

    nothing = 0.0, np.zeros(3)
    if len(residuals) < FEWEST:
        return nothing
    middle = points.mean(axis=0)
    p, n = (points - middle).T, normals.T
    lever = float(np.sqrt((p**2).sum(axis=0).mean()))
    if not lever > 0.0:
        return nothing
    strains = np.stack([n[i] * p[j] + (n[j] * p[i] if i != j else 0.0) for i, j in COMPONENTS]) / lever
    rows = np.vstack([plane_rows(points, normals, middle, lever), strains])
    # Outliers and neighbouring objects are one-sided, and would be taken for length.
    off = np.abs(residuals - _least_squares(rows, residuals) @ rows)
    kept = off <= OUTSIDE * median(off)
    rows, residuals = rows[:, kept], residuals[kept]
    rigid, both = (_least_squares(rows[:k], residuals) for k in (6, 12))
    left = [float(np.sum((residuals - x @ rows[: len(x)]) ** 2)) for x in (rigid, both)]
    spare = len(residuals) - 12
    if spare <= 0 or not left[0] - left[1] > float(fdtri(6, spare, 1.0 - CHANCE)) * 6.0 * left[1] / spare:
        return nothing
    if unexplained(both[6:] @ rows[6:], rows[:6], np.ones(len(residuals))) < least:
        return nothing
    E = np.zeros((3, 3))
    for value, (i, j) in zip(both[6:] / lever, COMPONENTS, strict=True):
        E[i, j] = E[j, i] = value
    values, axes = np.linalg.eigh(E)
    k = int(np.abs(values).argmax())
    along = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
    return (float(values[k]), along) if abs(values[k]) >= LEAST else nothing


def _least_squares(rows: FloatArray, residuals: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(rows @ rows.T)
    observable = values > UNOBSERVABLE * values[-1]
    inner = vectors[:, observable]
    solution: FloatArray = inner @ ((inner.T @ (rows @ residuals)) / values[observable])
    return solution
