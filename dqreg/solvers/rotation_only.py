"""`dqreg.solvers.solve_rotation`: the rotation of least cost from matched directions alone (Wahba's problem)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_weights
from dqreg._records import lock, one_line
from dqreg.errors import InputError
from dqreg.rigid import quaternion
from dqreg.solvers.closed_form import best_rotation
from dqreg.solvers.exact_cost import cost_of_pose
from dqreg.solvers.exact_matches import require_squares, rotation_beside
from dqreg.solvers.matches import Matches, read_matches, refuse_bad_values
from dqreg.solvers.moments import sums_of
from dqreg.solvers.uncertainty import counted, residual_variance, rotation_covariance


@dataclass(frozen=True, eq=False)
class RotationFit:
    """Rotation that minimises ``sum alpha |R m - n|^2``.

    Attributes
    ----------
    R_target_source : ndarray, (3, 3)
        Turns source directions into target directions.
    cost : float
        The minimised sum over the rows of finite weight.
    eigenvalue_gap : float
        As in `Fit`; beside exact rows, what the others hold the rest of the rotation with, in units of the most that
        they could; infinite where the exact rows leave nothing open.
    covariance : ndarray, (3, 3)
        Of the rotation vector, in radians, of a left increment along the target's axes: ``R_true = exp(e) R``. From
        the residuals, or from the weights (``absolute_weights=True``); NaN where no residual is left.

    Examples
    --------
    >>> RotationFit(np.eye(3), 0.0, 1.0, np.zeros((3, 3))).quaternion.tolist()
    [1.0, 0.0, 0.0, 0.0]
    """

    __repr__ = one_line
    R_target_source: FloatArray
    cost: float
    eigenvalue_gap: float
    covariance: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def quaternion(self) -> FloatArray:
        """The rotation as a unit quaternion.

        Returns
        -------
        ndarray, (4,)
            Scalar first.
        """
        return quaternion.from_matrix(self.R_target_source)


def solve_rotation(
    directions_source: ArrayLike,
    directions_target: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    absolute_weights: bool = False,
) -> RotationFit:
    """Rotation that best turns matched directions onto each other, in closed form.

    Parameters
    ----------
    directions_source, directions_target : array_like, (m, 3)
        Directions m and n; row i of one belongs to row i of the other. Weighed as given, never scaled to unit length.
    weights : array_like, (m,) or float, optional
        alpha >= 0; 1 where not given, 0 rejects a row. An infinite weight makes the match exact: one such direction
        leaves a rotation about it to the other rows, two that are not parallel leave nothing. Where the angles
        between exact directions differ from one side to the other, they are met as well as can be.
    absolute_weights : bool
        Whether the weights are 1 / variance, in radians and per tilt axis, as `likelihood_weights` gives them.

    Returns
    -------
    RotationFit

    Raises
    ------
    InputError
        If a shape or count is wrong, a number is not finite, a weight is negative or NaN, or there are no rows.
    DegenerateGeometryError
        If all directions that carry weight are parallel, or two rotations fit alike.

    Examples
    --------
    >>> fit = solve_rotation([[1.0, 0, 0], [0, 1, 0]], [[0.0, 1, 0], [-1, 0, 0]], weights=[np.inf, 1.0])
    >>> (fit.R_target_source.round(12) + 0.0).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    matches, exact = _read(directions_source, directions_target, weights)
    if exact.any():
        return _beside_exact(matches, exact, absolute_weights=absolute_weights)
    with np.errstate(over="ignore", invalid="ignore"):
        moments = sums_of(matches)
    if not moments.is_finite:
        raise InputError("the directions are finite, but their squares are not; give them in unit length")
    r, _, gap, H = best_rotation(moments, matches)
    R = quaternion.to_matrix(r)
    cost = _cost(R, matches)
    variance = 1.0 if absolute_weights else residual_variance(cost, 0, _counted(matches), 3)
    return RotationFit(R, cost, gap, variance * rotation_covariance(H, R, gap))


def _read(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None) -> tuple[Matches, np.ndarray]:
    none = np.zeros((0, 3))
    matches = read_matches(none, none, source, target)
    count = len(matches.directions_source)
    given = as_float(1.0 if weights is None else weights, "weights")
    exact = given == np.inf
    alpha = as_weights(np.where(exact, 0.0, given), "weights", count)
    exact = np.broadcast_to(exact, (count,))
    matches = read_matches(none, none, source, target, direction_weights=alpha)
    for weighed in (matches, read_matches(none, none, source, target, direction_weights=exact.astype(float))):
        refuse_bad_values(weighed)
    return matches, exact


def _beside_exact(matches: Matches, exact: np.ndarray, *, absolute_weights: bool) -> RotationFit:
    m, n, alpha = matches.directions_source, matches.directions_target, matches.direction_weights
    require_squares(np.ones(1) if alpha is None else alpha, m, n)
    found = rotation_beside((m[exact], n[exact]), matches)
    cost, variance = _cost(found.R, matches), 1.0
    if found.free and not absolute_weights:
        variance = residual_variance(cost, 0, _counted(matches), found.free)
    return RotationFit(found.R, cost, found.gap, variance * found.covariance)


def _cost(R: FloatArray, matches: Matches) -> float:
    T = np.eye(4)
    T[:3, :3] = R
    return cost_of_pose(T, matches)[1]


def _counted(matches: Matches) -> int:
    return counted(matches.direction_weights, len(matches.directions_source))
