"""Estimators: from weighted pairs to an absolute pose, always from the untouched source points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.icp.correspondences import Pairs
from dqreg.icp.plane_to_plane import form_of_pairs
from dqreg.solvers import Fit, moments_of, solve_moments, svd
from dqreg.solvers.newton import local_minimum
from dqreg.solvers.quadratic import QuadraticForm, plane_form

Estimator = Callable[[Pairs, FloatArray, float], Fit]


def points_and_normals(pairs: Pairs, weights: FloatArray, noise: float) -> Fit:
    """Walker, Shao and Volz's closed form on points and normals.

    With point variance ``noise^2`` and normals fitted to k neighbours (variance ``sigma_r^2 / (k lever)``), maximum
    likelihood asks for ``alpha / beta = k lever noise^2 / sigma_r^2``. The k points of a neighbourhood share their
    evidence, so k falls away; and the ratio of variances is held at one at most, because far from the answer ``noise``
    measures the misfit and not the sensor.
    """
    scan = pairs.scan
    with np.errstate(divide="ignore", invalid="ignore"):
        trust = np.minimum((noise / scan.residuals) ** 2, 1.0)
    alpha = weights * scan.levers * np.where(scan.levers > 0.0, trust, 0.0)
    used = (alpha > 0.0) & pairs.closest.normals.any(axis=1)
    if not used.any():
        return points_only(pairs, weights, noise)
    kept = weights > 0.0
    moments = moments_of(
        scan.points[kept],
        pairs.closest.points[kept],
        weights[kept],
        pairs.source_directions[used],
        pairs.closest.normals[used],
        alpha[used],
    )
    return solve_moments(moments)


def points_only(pairs: Pairs, weights: FloatArray, noise: float) -> Fit:
    """The same closed form on points alone."""
    kept = weights > 0.0
    return solve_moments(moments_of(pairs.scan.points[kept], pairs.closest.points[kept], weights[kept]))


def svd_points(pairs: Pairs, weights: FloatArray, noise: float) -> Fit:
    """Arun's SVD on points alone: the yardstick."""
    kept = weights > 0.0
    return svd(pairs.scan.points[kept], pairs.closest.points[kept], point_weights=weights[kept])


def points_to_planes(pairs: Pairs, weights: FloatArray, noise: float) -> Fit:
    """Points to the tangent planes of the target, by Newton's method from the last pose.

    Sliding along a face costs nothing, so the loop needs a handful of iterations where point steps need dozens. Far
    from the answer tangent planes mislead; the closed form goes there.
    """
    used = (weights > 0.0) & pairs.closest.normals.any(axis=1)
    if np.count_nonzero(used) < 6:
        return points_only(pairs, weights, noise)
    p, q, n, w = pairs.scan.points[used], pairs.closest.points[used], pairs.closest.normals[used], weights[used]
    origins = (w @ p / w.sum(), w @ q / w.sum())
    form = QuadraticForm(plane_form(p, q, n, w, origins), *origins)
    T = local_minimum(form, pairs.T_target_source)
    cost = form.value(T)
    return Fit(T, cost, float(np.sqrt(max(cost, 0.0) / w.sum())), np.nan)


def surfaces_to_surfaces(pairs: Pairs, weights: FloatArray, noise: float) -> Fit:
    """Surfaces onto surfaces, each pair weighed by the normals of both sides and by how sure they are.

    See `dqreg.icp.plane_to_plane`. Between two clouds, where either side's planes are guesses, it beats points to
    planes; on an exact mesh it does not.
    """
    used = (weights > 0.0) & pairs.closest.normals.any(axis=1)
    if np.count_nonzero(used) < 6:
        return points_only(pairs, weights, noise)
    form = form_of_pairs(pairs, weights)
    T = local_minimum(form, pairs.T_target_source)
    cost = max(form.value(T), 0.0)
    return Fit(T, cost, float(np.sqrt(cost / weights.sum())), np.nan)


ESTIMATORS: dict[str, Estimator] = {
    "dq": points_and_normals,
    "dq-points": points_only,
    "svd": svd_points,
    "plane": points_to_planes,
    "generalised": surfaces_to_surfaces,
}
