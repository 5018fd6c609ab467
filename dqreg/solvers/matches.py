"""Matched points and directions with their weights: what every solver takes, checked at the door.

Weights of maximum likelihood, the question that the paper of 1991 leaves open: for independent Gaussian noise the most
likely pose is the one of least cost with ``beta = 1 / sigma_p^2`` and ``alpha = 1 / sigma_n^2``, where sigma_p is the
noise of a point coordinate and sigma_n that of a direction, in radians, along each of the two ways it can tilt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_vectors, as_weights, require_finite, require_workable
from dqreg.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Row i of the source belongs to row i of the target; the two numbers of rows, n and m, may differ.

    Attributes
    ----------
    points_source, points_target : ndarray, (n, 3)
        Matched points, p and q.
    directions_source, directions_target : ndarray, (m, 3)
        Matched directions, called m and n in the formulas; no rows where none were given.
    point_weights : ndarray, (n,), or None
        beta, one a point; None where all are 1. Zero rejects a match.
    direction_weights : ndarray, (m,), or None
        alpha, one a direction; None where all are 1. Zero rejects a match.
    """

    points_source: FloatArray
    points_target: FloatArray
    directions_source: FloatArray
    directions_target: FloatArray
    point_weights: FloatArray | None = None
    direction_weights: FloatArray | None = None


def read_matches(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
) -> Matches:
    """Check shapes, counts and weights; the values of points and directions are left to `refuse_bad_values`.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Matched points.
    directions_source, directions_target : array_like, (m, 3), optional
        Matched directions; both or none.
    point_weights : array_like, (n,) or float, optional
        beta; 1 where not given.
    direction_weights : array_like, (m,) or float, optional
        alpha; 1 where not given.

    Returns
    -------
    Matches
        Float64 arrays; the caller's own where they already are.

    Raises
    ------
    InputError
        If a shape or a count is wrong, a weight is negative or not finite, or there are no matches at all.

    Examples
    --------
    >>> read_matches([[0, 0, 0]], [[1, 2, 3]]).directions_source.shape
    (0, 3)
    """
    matches = read_rows(
        points_source, points_target, directions_source, directions_target, point_weights, direction_weights
    )
    if not len(matches.points_source) and not len(matches.directions_source):
        raise InputError("points_source has no rows; at least one matched point is needed")
    return matches


def read_rows(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
) -> Matches:
    """`read_matches` where there may be none."""
    points = _read_pair(points_source, points_target, "points")
    if (directions_source is None) != (directions_target is None):
        missing = "directions_source" if directions_source is None else "directions_target"
        raise InputError(f"{missing} is missing; give the directions of both sides or of neither")
    if directions_source is None or directions_target is None:
        if direction_weights is not None:
            raise InputError("direction_weights was given without directions; give the directions or leave it out")
        directions = (np.zeros((0, 3)), np.zeros((0, 3)))
    else:
        directions = _read_pair(directions_source, directions_target, "directions")
    beta = None if point_weights is None else as_weights(point_weights, "point_weights", len(points[0]))
    alpha = (
        None if direction_weights is None else as_weights(direction_weights, "direction_weights", len(directions[0]))
    )
    return Matches(*points, *directions, beta, alpha)


def weights_of(matches: Matches) -> tuple[FloatArray, FloatArray]:
    """Weights beta (n,) and alpha (m,), ones where none were given."""
    beta, alpha = matches.point_weights, matches.direction_weights
    return (
        np.ones(len(matches.points_source)) if beta is None else beta,
        np.ones(len(matches.directions_source)) if alpha is None else alpha,
    )


def refuse_bad_values(matches: Matches) -> None:
    """Raise if a point or direction is not finite, or a direction has no length."""
    for name in ("points_source", "points_target", "directions_source", "directions_target"):
        array = getattr(matches, name)
        require_finite(array, name)
        if name.startswith("points") and len(array):
            require_workable(array, name)
        if name.startswith("directions"):
            refuse_zero_directions(array, name, matches.direction_weights)


def refuse_zero_directions(directions: FloatArray, name: str, weights: FloatArray | None = None) -> None:
    """Raise if a row that carries weight holds three zeros, which points nowhere. Shapes: weights (m,)."""
    empty = ~directions.any(axis=1)
    zero = np.flatnonzero(empty if weights is None else empty & (weights > 0.0))
    if zero.size:
        raise InputError(
            f"{name} holds {zero.size} directions of length zero, the first in row {zero[0]}; "
            "leave them out or give them weight 0"
        )


def _read_pair(source: ArrayLike, target: ArrayLike, kind: str) -> tuple[FloatArray, FloatArray]:
    pair = (
        as_vectors(source, f"{kind}_source", finite=False),
        as_vectors(target, f"{kind}_target", finite=False),
    )
    if len(pair[0]) != len(pair[1]):
        raise InputError(
            f"{kind}_source has {len(pair[0])} rows and {kind}_target {len(pair[1])}; "
            "row i of one must match row i of the other"
        )
    return pair


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
        Variance of a direction in squared radians along each of the two ways that it can tilt, for example from
        `normal_variance`.
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
    """Variance of a normal fitted to k neighbours, per tilt axis: ``sigma_r^2 / k (1/l1 + 1/l2) / 2``.

    The normal tilts along the two tangential axes by ``sigma_r^2 / (k l1)`` and ``sigma_r^2 / (k l2)``; this is their
    mean, which `likelihood_weights` takes as ``direction_variance``.

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
        sigma_n^2 in squared radians, the mean over both ways that the normal can tilt.

    Raises
    ------
    InputError
        If a number is negative, not finite, or k is less than 3.

    Examples
    --------
    >>> round(float(normal_variance(0.1, [1.0, 0.25], 10)), 9)
    0.0025
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
        looseness = (1.0 / spread).mean(axis=-1)
    variance: FloatArray = np.asarray(sigma**2 / k * looseness)
    return variance


def _positive(value: ArrayLike, name: str, *, endless: bool = False) -> FloatArray:
    array = as_float(value, name)
    if not endless or np.isnan(array).any():
        require_finite(array, name)
    if array.size and not array.min() > 0.0:
        raise InputError(f"{name} must be positive; the smallest is {array.min():g}")
    return array
