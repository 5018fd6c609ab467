"""Estimators: from weighted correspondences to an absolute pose, always from the untouched source points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.lowered_weights import lowered_weights
from dqreg.icp.weighing import NOTHING, counted
from dqreg.rigid import single_pose
from dqreg.solvers import Fit, Matches, solve_moments, svd
from dqreg.solvers.moments import sums_of
from dqreg.solvers.newton import FLAT_CURVATURE_RATIO, least_cost
from dqreg.solvers.quadratic import QuadraticForm

Estimator = Callable[[Correspondences, FloatArray, float], Fit]

# Correspondences with known normals from which on planes are used: fewer constrain less than six degrees of freedom.
MIN_PLANES = 6
# Variance of every normal, rad^2, beyond that of its fit: how far a surface bends between the points of two clouds.
# On 23 measured pairs of clouds 0.03 to 0.1 gave about the same errors, 0.001 and none larger ones.
BEND_VARIANCE = 0.04
# Less where the pairs say so: this share of the square of half their mean square along the planes' normals over that
# along one direction of the planes. Measured pairs came to 0.21 to 0.6 and keep 0.04, but those of a sequence of LiDAR
# scans, 0.1 to 0.14, which it leaves as good. Streets of planes under a LiDAR came to 0.01 to 0.06, views of parts to
# 0.005 to 0.1: their errors fell by 40 and 5 to 13 % against a share of the ratio itself. The points along a plane say
# less than they seem to: where they are is of the scanner, the same at both poses. With a least variance of 1e-3
# streets under 16 rings came four times as far off, and those under 64 twice.
BEND_VARIANCE_SHARE, MIN_BEND_VARIANCE = 0.7, 1e-4
# Pairs that are summed in one go: to hand over fewer costs more than it saves.
CHUNK_PAIRS = 8_192
# Correspondences from which on a step so short that the first order of its rotation is all of it is taken by
# Gauss-Newton: the sums of the exact cost take nearly three times as long, and of fewer no longer than a call.
GAUSS_NEWTON_PAIRS = 4_000
# Longest rotation: of the size half its square is left out, 5e-7, and its product with the noise, to the next step.
MAX_STEP_RAD = 1e-3
# Normals that are in the target's frame.
IDENTITY = np.eye(3)


def points_and_normals(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Walker, Shao and Volz's closed form on points and normals."""
    alpha = direction_weights(pairs, weights, noise)
    used = (alpha > 0.0) & nonzero_rows(pairs.closest.normals)
    if not used.any():
        return points_only(pairs, weights, noise)
    kept, directed = np.flatnonzero(weights > 0.0), np.flatnonzero(used)
    p, q, beta = (np.take(x, kept, axis=0) for x in (pairs.scan.points, pairs.closest.points, weights))
    m, n, alpha = (np.take(x, directed, axis=0) for x in (pairs.source_directions, pairs.closest.normals, alpha))
    return solve_moments(sums_of(Matches(p, q, m, n, beta, alpha)))


def direction_weights(pairs: Correspondences, weights: FloatArray, noise: float) -> FloatArray:
    """Weights alpha of the normals, (n,), beside the weights beta of the points.

    With point variance ``noise^2`` and normals fitted to k neighbours (variance ``sigma_r^2 / (2 k lever)`` per tilt
    axis), maximum likelihood asks for ``alpha / beta = 2 k lever noise^2 / sigma_r^2``. The k points of a neighbourhood
    share their evidence, so k falls away; the 2 was tried and moves the poses either way by a few per cent of their
    errors. The ratio of variances is held at one at most, because far from the answer ``noise`` measures the misfit and
    not the sensor.
    """
    scan = pairs.scan
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.minimum((noise / scan.residuals) ** 2, 1.0)
    alpha: FloatArray = weights * scan.levers * np.where(scan.levers > 0.0, ratio, 0.0)
    return alpha


def points_only(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """The same closed form on points alone."""
    on, none = weights > 0.0, np.zeros((0, 3))
    return solve_moments(sums_of(Matches(pairs.scan.points[on], pairs.closest.points[on], none, none, weights[on])))


def svd_points(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Arun's SVD on points alone, for comparison."""
    kept = weights > 0.0
    return svd(pairs.scan.points[kept], pairs.closest.points[kept], point_weights=weights[kept])


def points_to_planes(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Point-to-plane: the tangent planes of the target, by Newton's method from the last pose.

    Sliding along a face costs nothing, so the loop needs a handful of iterations where point steps need dozens. Far
    from the answer tangent planes mislead; the closed form goes there.
    """
    if (short := short_step(pairs, weights)) is not None:
        return _stepped(*short, weights)
    form = tangent_planes(pairs, weights)
    return points_only(pairs, weights, noise) if form is None else _newton_step(form, pairs, weights)


def short_step(pairs: Correspondences, weights: FloatArray) -> tuple[FloatArray, float] | None:
    """Pose of least point-to-plane cost, (4, 4), and the cost there; None where it is not near or not constrained.

    With rows ``J_i = [(x_i - o) x n_i, n_i]`` and heights ``h_i`` over the planes the twist about o solves
    ``sum w J J^T xi = -sum w J h``.
    """
    from dqreg.kernels.steps.weighted_planes import STEP, short_twist, step_sums
    from dqreg.kernels.threads import as_plain, over_chunks

    found, count = pairs.closest, len(weights)
    if count < GAUSS_NEWTON_PAIRS:
        return None
    columns = [as_plain(x) for x in (pairs.moved, found.points, found.normals, weights)]
    origin = pairs.moved[int(weights.argmax())]
    sums, step = np.zeros((-(-count // CHUNK_PAIRS), STEP)), np.zeros(6)
    over_chunks(step_sums, count, *columns, origin, CHUNK_PAIRS, sums, chunk=CHUNK_PAIRS)
    # All six at least as well held as what an exact step moves at all.
    cost = short_twist(sums, FLAT_CURVATURE_RATIO, step)
    if math.isnan(cost) or not math.hypot(*step[:3].tolist()) <= MAX_STEP_RAD:
        return None
    D = single_pose.exp(step)
    D[:3, 3] += origin - D[:3, :3] @ origin
    return D @ pairs.T_target_source, cost


def tangent_planes(pairs: Correspondences, weights: FloatArray) -> QuadraticForm | None:
    """The point-to-plane cost; None for too few normals."""
    from dqreg.kernels.steps.weighted_planes import COLUMNS, plane_sums
    from dqreg.kernels.threads import as_plain, over_chunks

    scan, found, count = pairs.scan, pairs.closest, len(weights)
    columns = [as_plain(x) for x in (scan.points, found.points, found.normals, weights)]
    # Any place among the points that count will do: the sums know their own means.
    some = int(weights.argmax())
    origins = np.array([scan.points[some], found.points[some]])
    sums = np.zeros((max(-(-count // CHUNK_PAIRS), 1), COLUMNS))
    over_chunks(plane_sums, count, *columns, origins, CHUNK_PAIRS, sums, chunk=CHUNK_PAIRS)
    if np.add.reduce(sums[:, -1]) < MIN_PLANES:
        return None
    return QuadraticForm(_form_of(sums, origins), *origins)


def surfaces_to_surfaces(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Plane-to-plane, each correspondence weighted by the normals of both sides and their variances.

    Between two clouds, where either side's planes are guesses, it beats point-to-plane; on an exact mesh it does not.
    """
    return _between_planes(pairs, lowered_weights(pairs, weights, is_last=False), noise)


def cells_to_cells(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """The same on the last level, where cells that stand far apart and points amid noise count less."""
    return _between_planes(pairs, lowered_weights(pairs, weights, is_last=True), noise)


def _between_planes(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    from dqreg.kernels.steps.weighted_planes import PLANE_PAIR_COLUMN

    moments = pair_sums(pairs, weights)
    if moments[PLANE_PAIR_COLUMN] < MIN_PLANES:
        return points_only(pairs, weights, noise)
    return _newton_step(both_planes(pairs, weights, moments), pairs, weights)


def both_planes(pairs: Correspondences, weights: FloatArray, moments: FloatArray) -> QuadraticForm:
    """The plane-to-plane cost, in units in which the distance between two sure and parallel planes counts once."""
    from dqreg.kernels.steps.weighted_planes import POINT_COLUMN, SQ_HEIGHT_COLUMN, WEIGHT_COLUMN

    scan, found, bend, turn = pairs.scan, pairs.closest, _bend(moments), pairs.T_target_source[:3, :3]
    spreads = NOTHING if found.variances is None else found.variances, scan._variances
    origins = moments[POINT_COLUMN:SQ_HEIGHT_COLUMN].reshape(2, 3) / moments[WEIGHT_COLUMN]
    columns = scan.points, found.points, found.normals, scan.normals, turn, *spreads, weights, origins
    form = _form_of(_disc_sums(columns, bend, 2.0 * bend), origins)
    return QuadraticForm(form, *origins)


def _bend(moments: FloatArray) -> float:
    """Variance of every normal beyond that of its fit, rad^2, as far as the pairs show it."""
    from dqreg.kernels.steps.plane_pass import bend_of
    from dqreg.kernels.steps.weighted_planes import SQ_DISTANCE_COLUMN, SQ_HEIGHT_COLUMN

    squares = float(moments[SQ_HEIGHT_COLUMN]), float(moments[SQ_DISTANCE_COLUMN])
    return bend_of(*squares, BEND_VARIANCE_SHARE, MIN_BEND_VARIANCE, BEND_VARIANCE)


def pair_sums(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    """Sums over correspondences, see `pair_moments`."""
    from dqreg.kernels.steps.weighted_planes import PAIR_COLUMNS, pair_moments
    from dqreg.kernels.threads import as_plain, over_chunks

    scan, found, scatter = pairs.scan, pairs.closest, counted(pairs.scan)[1]
    sums = np.zeros((max(-(-len(scan) // CHUNK_PAIRS), 1), PAIR_COLUMNS))
    columns = scan.points, pairs.T_target_source, found.points, found.normals, found.distances, scatter, weights
    over_chunks(pair_moments, len(scan), *map(as_plain, columns), CHUNK_PAIRS, sums, chunk=CHUNK_PAIRS)
    totals: FloatArray = sums.sum(axis=0)
    return totals


def plane_to_plane_form(
    p: FloatArray,
    q: FloatArray,
    directions: tuple[FloatArray, FloatArray],
    variances: tuple[FloatArray, FloatArray],
    weights: FloatArray,
    origins: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Matrix (13, 13) of ``sum w d^T C^-1 d``, ``d = R p + t - q``: generalised ICP (Segal et al. 2009), C held fixed.

    Around its point each surface is a disc: a point of it may stand anywhere along the disc, and off it by a fraction
    of the variance of its normal. With unit normals n of the target and m of the source (rotated to the target's
    frame, or to be rotated there), and variances e_n and e_m, the difference of two corresponding points has the
    covariance

        C = (I - (1 - e_n) n n^T) + (I - (1 - e_m) m m^T)

    in units that do not matter. With ``a = 1 - e_n``, ``b = 1 - e_m``, ``c = n . m`` Woodbury's identity gives the
    inverse as a sum of squares,

        C^-1 = 1/2 (I + k u u^T + b/(2 - b) m m^T),   u = n + b c/(2 - b) m,
        k = a (2 - b) / ((2 - a)(2 - b) - a b c^2),

    so that a correspondence is a point, a plane along u and a plane along m. Where both normals agree and are sure,
    the plane counts and the point hardly does; where they differ, the correspondence fades.
    """
    about = np.stack(origins)
    return _form_of(_disc_sums((p, q, *directions, IDENTITY, *variances, weights, about), 0.0, 1.0), about)


def _disc_sums(columns: Sequence[FloatArray], bend: float, factor: float) -> FloatArray:
    """Sums over pairs of discs, see `disc_pair_sums`, of chunks, (k, 73)."""
    from dqreg.kernels.steps.disc_pairs import disc_pair_sums
    from dqreg.kernels.steps.pose_forms import SUMS
    from dqreg.kernels.threads import as_plain, over_chunks

    plain, count = [as_plain(column) for column in columns], len(columns[0])
    # Added chunk by chunk, so that the bits are the same for any number of threads.
    sums = np.zeros((max(-(-count // CHUNK_PAIRS), 1), SUMS))
    over_chunks(disc_pair_sums, count, *plain, bend, factor, CHUNK_PAIRS, sums, chunk=CHUNK_PAIRS)
    return sums


def _form_of(sums: FloatArray, origins: FloatArray) -> FloatArray:
    """Matrix (13, 13) from sums over pairs, and the origins, (2, 3), moved where it is about others."""
    from dqreg.kernels.steps.pose_forms import NUMBERS, form_of_sums

    matrix = np.zeros((NUMBERS, NUMBERS))
    form_of_sums(sums, origins, matrix)
    return matrix


def _newton_step(form: QuadraticForm, pairs: Correspondences, weights: FloatArray) -> Fit:
    return _stepped(*least_cost(form, pairs.T_target_source), weights)


def _stepped(T: FloatArray, value: float, weights: FloatArray) -> Fit:
    cost = max(value, 0.0)
    return Fit(T, cost, math.sqrt(cost / float(weights.sum())), math.nan)


ESTIMATORS: dict[str, Estimator] = {
    "dq": points_and_normals,
    "dq-points": points_only,
    "svd": svd_points,
    "plane": points_to_planes,
    "generalised": surfaces_to_surfaces,
}
