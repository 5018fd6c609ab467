"""Weights of maximum likelihood: the question that the paper of 1991 leaves open.

For independent Gaussian noise the pose of greatest likelihood is the one of least cost with
``beta = 1 / sigma_p^2`` and ``alpha = 1 / sigma_n^2``: sigma_p the noise of a point coordinate, sigma_n the noise of a
direction, in radians, along each of the two ways it can tilt.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import InputError


class LikelihoodWeights(NamedTuple):
    """Weights for `solve`.

    Attributes
    ----------
    point_weights : ndarray
        beta, one over a squared length.
    direction_weights : ndarray
        alpha, one over squared radians; no entries where no variance of directions was given.
    """

    point_weights: FloatArray
    direction_weights: FloatArray


def likelihood_weights(
    point_sigma: ArrayLike, direction_variance: ArrayLike | None = None, *, shared_neighbours: ArrayLike = 1
) -> LikelihoodWeights:
    """Weights beta and alpha that make the least cost the greatest likelihood.

    Parameters
    ----------
    point_sigma : array_like, () or (n,)
        Standard deviation of a point coordinate, in lengths, of the difference between source and target.
    direction_variance : array_like, () or (m,), optional
        Variance of a direction in squared radians, for example from `normal_variance`.
    shared_neighbours : array_like, () or (m,)
        By how many each alpha is divided. Normals fitted to the very points that are matched are not independent
        evidence: the same noise enters both. And normals of k neighbours that share their neighbourhoods repeat each
        other: each point takes part in about k fits, so the m normals hold the information of about m / k. Pass k
        to count them once; keep 1 for directions measured on their own, such as probed planes and axes.

    Returns
    -------
    LikelihoodWeights
        ``point_weights`` and ``direction_weights`` in the shapes given.

    Raises
    ------
    InputError
        If a number is not positive and finite. A variance of infinity is allowed: the weight is zero.

    Examples
    --------
    >>> weights = likelihood_weights(0.1, [0.01, 0.04], shared_neighbours=10)
    >>> weights.point_weights.round(9).tolist(), weights.direction_weights.round(9).tolist()
    (100.0, [10.0, 2.5])
    """
    sigma = _positive(point_sigma, "point_sigma")
    variance = _positive([] if direction_variance is None else direction_variance, "direction_variance", endless=True)
    shared = _positive(shared_neighbours, "shared_neighbours")
    if shared.size and shared.min() < 1.0:
        raise InputError(f"shared_neighbours must be 1 or more; the smallest is {shared.min():g}")
    if shared.ndim and shared.shape != variance.shape:
        raise InputError(
            f"shared_neighbours must be one number or one per direction; got {shared.shape} for {variance.shape}"
        )
    return LikelihoodWeights(1.0 / sigma**2, 1.0 / (variance * shared))


def normal_variance(residual_sigma: ArrayLike, tangential_variances: ArrayLike, neighbours: ArrayLike) -> FloatArray:
    """Variance of a normal fitted to k neighbours: ``sigma_r^2 / k (1/l1 + 1/l2)``.

    A plane fitted to few points, to noisy ones, or to a narrow strip such as an edge or a grazing view leaves, has
    an uncertain normal and so weighs itself down.

    Parameters
    ----------
    residual_sigma : array_like, () or (m,)
        sigma_r, standard deviation of the neighbours off their plane, in lengths.
    tangential_variances : array_like, (..., 2)
        l1 and l2, variances of the neighbours along the plane, in squared lengths: the two larger eigenvalues of
        their covariance. A zero makes the variance infinite and the weight zero.
    neighbours : array_like, () or (m,)
        k, at least 3.

    Returns
    -------
    ndarray
        sigma_n^2 in squared radians, both tilts together as the formula has it.

    Raises
    ------
    InputError
        If a number is negative, not finite, or k is less than 3.

    Examples
    --------
    >>> round(float(normal_variance(0.1, [1.0, 0.25], 10)), 9)
    0.005
    """
    sigma = _positive(residual_sigma, "residual_sigma")
    spread = as_float(tangential_variances, "tangential_variances")
    if spread.ndim < 1 or spread.shape[-1] != 2:
        raise InputError(f"tangential_variances must have two numbers in its last axis; got shape {spread.shape}")
    require_finite(spread, "tangential_variances")
    if spread.size and spread.min() < 0.0:
        raise InputError(f"tangential_variances must not be negative; the smallest is {spread.min():g}")
    k = _positive(neighbours, "neighbours")
    if k.size and k.min() < 3.0:
        raise InputError(f"neighbours must be 3 or more, which a plane needs; the smallest is {k.min():g}")
    with np.errstate(divide="ignore"):
        looseness = (1.0 / spread).sum(axis=-1)
    variance: FloatArray = np.asarray(sigma**2 / k * looseness)
    return variance


def _positive(value: ArrayLike, name: str, *, endless: bool = False) -> FloatArray:
    array = as_float(value, name)
    if not endless or np.isnan(array).any():
        require_finite(array, name)
    if array.size and not array.min() > 0.0:
        raise InputError(f"{name} must be positive; the smallest is {array.min():g}")
    return array
