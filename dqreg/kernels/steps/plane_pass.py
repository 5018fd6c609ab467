"""One pass over few correspondences between two clouds: weights, plane-to-plane cost, and the pose of least cost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.steps.disc_pairs import disc_pair_sums
from dqreg.kernels.steps.lowered_weights import lower_by_distance, lower_by_height, lower_by_noise
from dqreg.kernels.steps.pose_forms import NUMBERS, SUMS, form_of_sums, least_cost_pose
from dqreg.kernels.steps.weighing import weigh_rows
from dqreg.kernels.steps.weighted_planes import (
    FOOT_COLUMN,
    PAIR_COLUMNS,
    PLANE_PAIR_COLUMN,
    POINT_COLUMN,
    SQ_DISTANCE_COLUMN,
    SQ_HEIGHT_COLUMN,
    WEIGHT_COLUMN,
    pair_moments,
)


class Lowering(NamedTuple):
    """How weights are lowered; zero where they are not."""

    heights: float  # In their median, see `lower_by_height`
    smoothed: float  # Noise that both clouds were rid of, a length
    distances: float  # In their median, see `lower_by_distance`
    variance: float  # Of both normals, see `lower_by_noise`
    sure: float  # Share of the pairs that are sure in any case


class Stepping(NamedTuple):
    """How a step is taken."""

    planes: int  # Pairs with planes at least
    bend: float  # Share, see `bend_of`
    least_bend: float
    most_bend: float
    steps: int  # And further limits of `least_cost_pose`
    nothing: float
    noise: float
    longest: float
    flat: float


@compiled
def bend_of(square_height: float, square_distance: float, share: float, least: float, most: float) -> float:
    """Variance of every normal beyond that of its fit, rad^2, by sums of squares over correspondences."""
    beside = 0.5 * (square_distance - square_height)
    if not beside > 0.0:
        return most
    ratio = 0.5 * square_height / beside
    return min(max(share * (ratio * ratio), least), most)


@compiled
def lower_weights(
    moved: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    flat: BoolArray,
    standing: FloatArray,
    moving: FloatArray,
    lowering: Lowering,
    weights: FloatArray,
) -> None:
    """Lower weights, (n,), as far as is asked. O(n)."""
    if lowering.distances > 0.0:
        lower_by_distance(distances, flat, lowering.distances, weights)
    if lowering.variance > 0.0:
        lower_by_noise(standing, moving, lowering.variance, lowering.sure, weights)
    if lowering.heights > 0.0:
        lower_by_height(moved, feet, normals, lowering.heights, lowering.smoothed, weights)


@compiled
def plane_pass(
    T: FloatArray,
    points: FloatArray,
    moved: FloatArray,
    own: FloatArray,
    rejecting: FloatArray,
    moving: FloatArray,
    counts: FloatArray,
    scatter: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    standing: FloatArray,
    flat: BoolArray,
    kept: FloatArray,
    limits: FloatArray,
    lowering: Lowering,
    stepping: Stepping,
    chunk: int,
    weights: FloatArray,
    lowered: FloatArray,
    sums: FloatArray,
    found: FloatArray,
) -> float:
    """Write weights, (n,), and these lowered; their sums, see `weigh_rows`; and the pose of least cost, (4, 4). O(n).

    Returns that cost, NaN where too few correspondences have planes, and there is no pose. Sums are taken in chunks of
    rows, as on several threads. Shapes: T (4, 4); of the source points, these moved, their normals, those that may
    reject, their variances, counts and scatter; of the target points, normals, distances, variances and which planes
    are flat far around; further factors of the weights.
    """
    count, turn, chunks = len(points), T[:3, :3].copy(), max(-(-len(points) // chunk), 1)
    own_rows = rejecting, turn, counts, scatter, kept, limits
    begin = count - count  # a literal 0 would be a type of its own
    weigh_rows(begin, count, distances, normals, *own_rows, count + 1, weights, sums)
    lowered[:] = weights
    lower_weights(moved, feet, normals, distances, flat, standing, moving, lowering, lowered)
    moments, totals = np.zeros((chunks, PAIR_COLUMNS)), np.zeros(PAIR_COLUMNS)
    for first in range(begin, count, chunk):
        last = min(first + chunk, count)
        pair_moments(first, last, points, T, feet, normals, distances, scatter, lowered, chunk, moments)
    for c in range(chunks):
        for k in range(PAIR_COLUMNS):
            totals[k] += moments[c, k]
    if totals[PLANE_PAIR_COLUMN] < stepping.planes:
        return np.nan
    squares = totals[SQ_HEIGHT_COLUMN], totals[SQ_DISTANCE_COLUMN]
    bend = bend_of(*squares, stepping.bend, stepping.least_bend, stepping.most_bend)
    origins, forms, matrix = np.zeros((2, 3)), np.zeros((chunks, SUMS)), np.zeros((NUMBERS, NUMBERS))
    for k in range(3):
        origins[0, k] = totals[POINT_COLUMN + k] / totals[WEIGHT_COLUMN]
        origins[1, k] = totals[FOOT_COLUMN + k] / totals[WEIGHT_COLUMN]
    factor = 2.0 * bend
    for first in range(begin, count, chunk):
        last, given = min(first + chunk, count), (standing, moving, lowered, origins, bend, factor, chunk, forms)
        disc_pair_sums(first, last, points, feet, normals, own, turn, *given)
    form_of_sums(forms, origins, matrix)
    tails = stepping.nothing, stepping.noise, stepping.longest, stepping.flat
    return least_cost_pose(matrix, origins, T, stepping.steps, *tails, found)
