"""Estimation methods of Open3D, and two of our own beside them, as pose steps of our loop."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.icp import ESTIMATORS, Correspondences, Estimator
from dqreg.icp.estimators import plane_to_plane_form
from dqreg.solvers import Fit
from dqreg.solvers.newton import local_minimum
from dqreg.solvers.quadratic import QuadraticForm
from dqreg.solvers.robust import Huber, Tukey

# A pose has six unknowns: fewer pairs than this fix none, whatever the step.
FEWEST_PAIRS = 3
# Below this, a kernel without a limit would weigh a residual of zero infinitely.
MIN_RESIDUAL = 1e-300


@dataclasses.dataclass(frozen=True)
class TransformationEstimationDualQuaternion:
    """Walker, Shao and Volz's closed form on points: the least squares of Open3D's point-to-point."""

    kernel: Any = None  # One of Open3D's robust kernels, of the distances


@dataclasses.dataclass(frozen=True)
class TransformationEstimationDualQuaternionNormals:
    """The same closed form on points and normals; normals that a cloud lacks are fitted to its neighbours."""

    kernel: Any = None  # One of Open3D's robust kernels, of the distances


@dataclasses.dataclass(frozen=True)
class Method:
    """A pose step, and what it needs."""

    estimator: Estimator
    with_normals: bool = False  # Whether the source needs normals too


STEPS = {
    "TransformationEstimationDualQuaternion": "dq-points",
    "TransformationEstimationDualQuaternionNormals": "dq",
    "TransformationEstimationPointToPoint": "dq-points",
    "TransformationEstimationPointToPlane": "plane",
    "TransformationEstimationForGeneralizedICP": "generalised",
}


def read_method(method: Any, default: str = "dq-points") -> Method:
    """Pose step of an object of Open3D's or ours; None is the default."""
    step = default if method is None else STEPS.get(type(method).__name__)
    if step is None:
        raise InputError(f"unknown estimation method {type(method).__name__}; known are {', '.join(STEPS)}")
    kernel = getattr(method, "kernel", None)
    if step == "generalised":
        return Method(_generalised(float(getattr(method, "epsilon", 1e-3)), kernel), with_normals=True)
    return Method(_weighed(ESTIMATORS[step], kernel, planes=step == "plane"), with_normals=step == "dq")


def kernel_weights(kernel: Any, residuals: FloatArray) -> FloatArray:
    """Weights of a robust kernel of Open3D's, (n,), by its name: its own function takes one number a call."""
    name, r = type(kernel).__name__, np.abs(residuals)
    if kernel is None or name == "L2Loss":
        return np.ones(len(r))
    if name == "L1Loss":
        return np.asarray(1.0 / np.maximum(r, MIN_RESIDUAL))
    k = float(getattr(kernel, "k", np.nan))
    if name == "HuberLoss":
        return Huber(k).weight(r)
    if name == "CauchyLoss":
        return np.asarray(1.0 / (1.0 + (r / k) ** 2))
    if name == "GMLoss":
        return np.asarray(k / (k + r**2) ** 2)
    if name == "TukeyLoss":
        return Tukey(k).weight(r)
    raise InputError(
        f"unknown robust kernel {name}; known are L2Loss, L1Loss, HuberLoss, CauchyLoss, GMLoss, TukeyLoss"
    )


def _weighed(estimator: Estimator, kernel: Any, *, planes: bool) -> Estimator:
    """The estimator under a robust kernel of the residuals that it minimises, as they are before the step."""

    def step(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
        residuals = pairs.point_to_plane if planes else pairs.distances
        return estimator(pairs, enough(weights * kernel_weights(kernel, residuals)), noise)

    return estimator if kernel is None else step


def _generalised(epsilon: float, kernel: Any) -> Estimator:
    """Generalised ICP (Segal et al. 2009): discs of variance 1 along the surface and epsilon across, on both sides."""
    if not 0.0 < epsilon <= 1.0:
        raise InputError(f"epsilon must be above 0 and at most 1; got {epsilon!r}")

    def step(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
        used = np.flatnonzero(weights > 0.0)
        p, q, n = pairs.scan.points[used], pairs.closest.points[used], pairs.closest.normals[used]
        m = pairs.scan.normals[used] @ pairs.T_target_source[:3, :3].T
        w, origins = weights[used], (p.mean(axis=0), q.mean(axis=0))
        if kernel is not None:
            w = enough(w * kernel_weights(kernel, _mahalanobis(pairs.moved[used] - q, n, m, epsilon)))
        variances = np.full(len(used), epsilon)
        form = QuadraticForm(plane_to_plane_form(p, q, (n, m), (variances, variances), w, origins), *origins)
        T = local_minimum(form, pairs.T_target_source)
        cost = max(form.value(T), 0.0)
        return Fit(T, cost, float(np.sqrt(cost / w.sum())), np.nan)

    return step


def _mahalanobis(d: FloatArray, n: FloatArray, m: FloatArray, epsilon: float) -> FloatArray:
    eye = np.eye(3)
    C = sum((eye - (1.0 - epsilon) * each[:, :, None] * each[:, None, :] for each in (n, m)), np.zeros((3, 3)))
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", d, np.linalg.solve(C, d[:, :, None])[:, :, 0])))


def enough(weights: FloatArray) -> FloatArray:
    """The weights; an error where a kernel has left too few."""
    if np.count_nonzero(weights) < FEWEST_PAIRS:
        raise DegenerateGeometryError("the robust kernel rejects all correspondences; give it a larger k")
    return weights
