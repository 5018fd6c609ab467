"""`dqreg.solvers.walker1991`: the algorithm of the paper by its own numbers, to measure others by.

M. W. Walker, L. Shao and R. A. Volz, "Estimating 3-D location parameters using dual number quaternions", CVGIP: Image
Understanding 54 (1991). Equation numbers stand at the lines. Quaternions in this file are the paper's: the scalar
comes last. Superscript 0 is the model, our source; the tilde is the measurement, our target.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid._operands import as_quaternions, as_triples
from dqreg.solvers.closed_form import require_determined
from dqreg.solvers.exact_cost import cost_of_pose
from dqreg.solvers.fit import Fit
from dqreg.solvers.least_squares import with_uncertainty
from dqreg.solvers.matches import Matches, read_matches, refuse_bad_values, weights_of
from dqreg.solvers.moments import sums_of
from dqreg.solvers.undetermined_rotation import no_weight_message, undetermined

__all__ = ["E", "Q", "W", "WalkerFit", "direction_quaternions", "position_quaternions", "walker1991"]


@dataclass(frozen=True, eq=False)
class WalkerFit(Fit):
    """A fit with the quantities of the paper beside it.

    Attributes
    ----------
    r, s : ndarray, (4,)
        Real and dual part of the dual quaternion in the paper's order, the scalar last.
    lambda_1 : float
        Largest eigenvalue of A (eq. 46).
    constant : float
        Eq. (38), which holds for directions of unit length; then ``cost = constant - lambda_1`` (eq. 50).
    C1, C2, C3 : ndarray, (4, 4)
        Eqs. (35) to (37): the error is ``r^T C1 r + s^T C2 s + s^T C3 r + constant`` (eq. 34).
    A : ndarray, (4, 4)
        Eq. (47), whose largest eigenvector is r.
    """

    r: FloatArray
    s: FloatArray
    lambda_1: float
    constant: float
    C1: FloatArray
    C2: FloatArray
    C3: FloatArray
    A: FloatArray


def walker1991(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
    *,
    absolute_weights: bool = False,
) -> WalkerFit:
    """Pose by the DQ localization algorithm as published, with its weights and its half-scaled position quaternions.

    A position quaternion is half the point (eq. 26), so beta weighs a quarter of the squared distance:
    ``walker1991`` with beta is `solve` with ``beta / 4``, in pose and in cost. As published the points are not
    centred, so points far from the origin lose digits; `solve` does not.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Modelled points p^0 and measured points p~.
    directions_source, directions_target : array_like, (m, 3), optional
        Modelled directions n^0 and measured directions n~, of unit length in the paper.
    point_weights, direction_weights : array_like or float, optional
        beta and alpha; 1 where not given.
    absolute_weights : bool
        As in `solve`, for ``beta / 4`` and alpha.

    Returns
    -------
    WalkerFit
        ``cost`` is the paper's E (eq. 31); ``rms`` is the distance of the points, not its half.

    Raises
    ------
    InputError
        As `solve`, and for coordinates beyond 1e60 or apart by less than 1e-60.
    DegenerateGeometryError
        As `solve`.

    Examples
    --------
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> walker1991(points, points + [1, 2, 3]).T_target_source[:3, 3].round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    matches = read_matches(
        points_source, points_target, directions_source, directions_target, point_weights, direction_weights
    )
    refuse_bad_values(matches)
    beta, alpha = weights_of(matches)
    if not beta.sum() > 0.0:
        raise DegenerateGeometryError(no_weight_message())
    p0, p = position_quaternions(matches.points_source), position_quaternions(matches.points_target)  # (26)
    n0, n = direction_quaternions(matches.directions_source), direction_quaternions(matches.directions_target)  # (27)
    C1 = -2.0 * _sum_QtW(alpha, n, n0) - 2.0 * _sum_QtW(beta, p, p0)  # (35)
    C2 = beta.sum() * np.eye(4)  # (36)
    C3 = 2.0 * np.einsum("i,iab->ab", beta, W(p0) - Q(p))  # (37)
    constant = 2.0 * alpha.sum() + beta @ ((p0 * p0).sum(axis=1) + (p * p).sum(axis=1))  # (38)
    inverse = np.linalg.inv(C2 + C2.T)
    A = 0.5 * (C3.T @ inverse @ C3 - C1 - C1.T)  # (47)
    values, vectors = np.linalg.eigh(A)  # (46)
    r = vectors[:, 3]  # of the largest eigenvalue: (50)
    s = -inverse @ C3 @ r  # (45)
    fit = _as_fit(r, s, values, float(constant), matches, (C1, C2, C3, A))
    quarter = replace(matches, point_weights=0.25 * beta)
    return with_uncertainty(fit, quarter, sums_of(quarter), absolute_weights=absolute_weights)


def position_quaternions(points: ArrayLike) -> FloatArray:
    """Half of each point, with a scalar of zero (eq. 26).

    Parameters
    ----------
    points : array_like, (..., 3)
        Points.

    Returns
    -------
    ndarray, (..., 4)
        In the paper's order, the scalar last.

    Raises
    ------
    InputError
        If the last axis does not hold three numbers.

    Examples
    --------
    >>> position_quaternions([1, 2, 3]).tolist()
    [0.5, 1.0, 1.5, 0.0]
    """
    return _with_zero(0.5 * as_triples(points, "points"))


def direction_quaternions(directions: ArrayLike) -> FloatArray:
    """Each direction, with a scalar of zero (eq. 27).

    Parameters
    ----------
    directions : array_like, (..., 3)
        Unit directions.

    Returns
    -------
    ndarray, (..., 4)
        In the paper's order, the scalar last.

    Raises
    ------
    InputError
        If the last axis does not hold three numbers.

    Examples
    --------
    >>> direction_quaternions([0, 0, 1]).tolist()
    [0.0, 0.0, 1.0, 0.0]
    """
    return _with_zero(as_triples(directions, "directions"))


def E(
    T_target_source: ArrayLike,
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
) -> float:
    """Error of a pose in the paper's scale (eq. 31); `walker1991` minimises it.

    Parameters
    ----------
    T_target_source : array_like, (4, 4)
        Any pose.
    points_source, points_target, directions_source, directions_target, point_weights, direction_weights : array_like
        As in `walker1991`.

    Returns
    -------
    float
        ``sum alpha |n~ - R n^0|^2 + sum beta |p~ - (R p^0 + t)|^2 / 4``: a position quaternion is half the point.

    Raises
    ------
    InputError
        If the pose is not rigid, or the matches are none of `walker1991`.

    Examples
    --------
    >>> E(np.eye(4), [[0, 0, 0]], [[0, 0, 2]])
    1.0
    """
    matches = read_matches(
        points_source, points_target, directions_source, directions_target, point_weights, direction_weights
    )
    refuse_bad_values(matches)
    point_cost, direction_cost = cost_of_pose(as_pose(T_target_source, "T_target_source"), matches)
    return 0.25 * point_cost + direction_cost


def Q(a: ArrayLike) -> FloatArray:
    """Matrices of a product from the left, ``Q(a) b = a b`` (eq. 15).

    Parameters
    ----------
    a : array_like, (..., 4)
        Quaternions in the paper's order, the scalar last.

    Returns
    -------
    ndarray, (..., 4, 4)
        Matrices for that order; `quaternion.left_matrix` is the one for ours.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> (Q([1, 0, 0, 0]) @ [0, 1, 0, 0]).tolist()
    [0.0, 0.0, 1.0, 0.0]
    """
    return _matrix(as_quaternions(a, "a"), 1.0)


def W(a: ArrayLike) -> FloatArray:
    """Matrices of a product from the right, ``W(a) b = b a`` (eq. 16).

    Parameters
    ----------
    a : array_like, (..., 4)
        Quaternions in the paper's order, the scalar last.

    Returns
    -------
    ndarray, (..., 4, 4)
        Matrices for that order; `quaternion.right_matrix` is the one for ours.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> (W([1, 0, 0, 0]) @ [0, 1, 0, 0]).tolist()
    [0.0, 0.0, -1.0, 0.0]
    """
    return _matrix(as_quaternions(a, "a"), -1.0)


def _matrix(a: FloatArray, side: float) -> FloatArray:
    a1, a2, a3, a4 = np.moveaxis(a, -1, 0)
    k1, k2, k3 = side * a1, side * a2, side * a3
    rows = [[a4, -k3, k2, a1], [k3, a4, -k1, a2], [-k2, k1, a4, a3], [-a1, -a2, -a3, a4]]  # K by (5)
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _sum_QtW(weights: FloatArray, measured: FloatArray, model: FloatArray) -> FloatArray:
    total: FloatArray = np.einsum("i,iba,ibc->ac", weights, Q(measured), W(model))
    return total


def _with_zero(vectors: FloatArray) -> FloatArray:
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 1))], axis=-1)


def _as_fit(
    r: FloatArray, s: FloatArray, values: FloatArray, constant: float, matches: Matches, sums: tuple[FloatArray, ...]
) -> WalkerFit:
    # A is 2 N plus a multiple of the identity; lambda_1 of N, which the gap relates to, needs that multiple taken out.
    centre = values.mean()
    why = functools.partial(undetermined, matches=matches, centred=False)
    gap = require_determined(float(values[3] - centre), float(values[3] - values[2]), reach=constant, why=why)
    T = np.eye(4)
    T[:3, :3] = (W(r).T @ Q(r))[:3, :3]  # (18)
    T[:3, 3] = 2.0 * (W(r).T @ s)[:3]  # (19), (20)
    point_cost, direction_cost = cost_of_pose(T, matches)
    rms = math.sqrt(point_cost / weights_of(matches)[0].sum())
    return WalkerFit(T, 0.25 * point_cost + direction_cost, rms, gap, r, s, float(values[3]), constant, *sums)  # (31)
