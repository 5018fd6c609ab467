"""An estimator for locked motions and for a pose known beforehand; both enter the cost, nothing is zeroed after it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg.errors import DegenerateGeometryError
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.estimators import Estimator, direction_weights, tangent_planes
from dqreg.solvers import Fit, Freedom, PoseCost
from dqreg.solvers.minimise import FREE_CURVATURE_RATIO, minimise
from dqreg.solvers.newton import FLAT_CURVATURE_RATIO
from dqreg.solvers.quadratic import QuadraticForm, direction_form, point_form, projected_form

# From pairs and weights to what leaves of a twist about the target's origin what the shape holds, (6, 6); None: all.
HeldOf = Callable[[Correspondences, FloatArray], FloatArray | None]


def constrained(
    freedom: Freedom,
    reference: FloatArray,
    prior: PoseCost | None = None,
    *,
    planes: bool = True,
    held_of: HeldOf | None = None,
) -> Estimator:
    """Estimator whose poses differ from a reference by allowed motions only.

    Each step minimises ``sum w d^2 / noise^2 + prior`` over the allowed poses, by Newton's method from the last one.
    While the noise of a stage is large the prior leads; as it falls, the pairs take over as far as the covariance of
    the prior says. The pairs count as independent. What the shape does not hold is left to the prior alone: facets
    would turn a round shaft.
    """
    # A prior is there for what the pairs hardly feel; without one that is left alone, as `points_to_planes` does.
    flat = FLAT_CURVATURE_RATIO if prior is None else FREE_CURVATURE_RATIO

    def estimate(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
        if not weights.any():
            raise DegenerateGeometryError("no pair carries weight, so nothing says where the source belongs")
        data = tangent_planes(pairs, weights) if planes else None
        data = data or _points(pairs, weights, noise)
        form = data
        if prior is not None:
            held = None if held_of is None else held_of(pairs, weights)
            variance = _variance(pairs, weights, noise)
            if held is not None:
                form = projected_form(data, pairs.T_target_source, held, variance * _tether(pairs))
            form = form + (prior * variance).form
        T = minimise(form, pairs.T_target_source, freedom, reference, flat, escape=False).T_target_source
        cost = max(data.value(T), 0.0)
        return Fit(T, cost, float(np.sqrt(cost / weights.sum())), np.nan)

    return estimate


def _points(pairs: Correspondences, weights: FloatArray, noise: float) -> QuadraticForm:
    used = weights > 0.0
    p, q, w = pairs.scan.points[used], pairs.closest.points[used], weights[used]
    origins = (w @ p / w.sum(), w @ q / w.sum())
    alpha = direction_weights(pairs, weights, noise)
    known = (alpha > 0.0) & nonzero_rows(pairs.closest.normals)
    directions = direction_form(pairs.source_directions[known], pairs.closest.normals[known], alpha[known])
    return QuadraticForm(point_form(p, q, w, origins) + directions, *origins)


def _tether(pairs: Correspondences) -> FloatArray:
    # By the size of the target from one step to the next: a prior that says nothing of a motion, about an axis that is
    # tilted a little, would leap along it.
    size = 1.0 if pairs.surface is None else pairs.surface.diagonal
    return np.array([0.25, 0.25, 0.25, size**-2, size**-2, size**-2])


def _variance(pairs: Correspondences, weights: FloatArray, noise: float) -> float:
    """Of one distance: from the scale of the stage, or from the distances where it has none."""
    return float(noise**2 if np.isfinite(noise) else dot(weights, pairs.distances**2) / weights.sum())
