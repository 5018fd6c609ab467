"""Alignment of points to nominal places along directions: reference points (RPS)."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose, as_vectors, as_weights, require_workable
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.alignment.earlier_steps import left_of, with_kept
from dqreg.inspection.alignment.priors import inverse_within, prior_about
from dqreg.solvers import Freedom, PoseCost


@dataclasses.dataclass(frozen=True, eq=False)
class PointAlignment:
    """The pose of points with directions.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Maps the measured points to the nominal ones.
    covariance : ndarray, (6, 6)
        Of the left increment about ``centre`` (rotation vector, then translation), for the given sigmas.
    centre : ndarray, (3,)
        Mean of the nominal points.
    residuals : ndarray, (n,)
        Deviation of each point along its direction after the alignment, a length; 0 for six points.
    """

    T_target_source: FloatArray
    covariance: FloatArray
    centre: FloatArray
    residuals: FloatArray


def align_points(
    points: ArrayLike,
    nominals: ArrayLike,
    directions: ArrayLike,
    *,
    sigma: ArrayLike = 1.0,
    start: ArrayLike | None = None,
    dof: Freedom | str | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
) -> PointAlignment:
    """Reference point alignment (RPS): each point is held along its direction, six of them fix the pose exactly.

    Parameters
    ----------
    points, nominals : array_like, (n, 3)
        Measured points, and where they should be.
    directions : array_like, (n, 3)
        Direction along which each point counts, part's frame; a point that counts along two is given twice.
    sigma : float or array_like, (n,)
        Standard deviation of each point along its direction; more than six points are balanced by it.
    start : array_like, (4, 4), optional
        A pose near the answer. Default: the identity.
    dof : Freedom or str, optional
        Degrees of freedom away from ``start``; the others keep it exactly.
    prior : (pose, covariance), optional
        A pose known beforehand, as in `PoseCost.prior` about the mean of the nominal points.

    Returns
    -------
    PointAlignment
        With what is left along each direction.

    Raises
    ------
    InputError
        If the arrays do not fit together, or a sigma is not above 0.
    DegenerateGeometryError
        If the points leave a degree of freedom unconstrained; the message names it.

    Examples
    --------
    >>> nominals = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 0], [9, 0, 0], [0, 0, 0.0]])
    >>> directions = np.eye(3)[[2, 2, 2, 1, 1, 0]]
    >>> found = align_points(nominals + [1, 2, 3], nominals, directions)
    >>> (found.T_target_source[:3, 3].round(12) + 0.0).tolist()
    [-1.0, -2.0, -3.0]
    """
    p, q, n = (
        as_vectors(x, name) for x, name in ((points, "points"), (nominals, "nominals"), (directions, "directions"))
    )
    if not len(p) == len(q) == len(n) or not len(p):
        raise InputError(
            f"points, nominals and directions must be as many, one at least; got {len(p)}, {len(q)} and {len(n)}"
        )
    require_workable(p, "points")
    require_workable(q, "nominals")
    lengths = np.linalg.norm(n, axis=1)
    if not (lengths > 0.0).all():
        raise InputError(f"direction {int(np.argmin(lengths))} has no length")
    n = n / lengths[:, None]
    spread = as_weights(sigma, "sigma", len(p))
    if not (spread > 0.0).all():
        raise InputError("sigma must be a length above 0 for each point")
    cost = PoseCost.planes(p, q, n, spread**-2.0)
    centre = q.mean(axis=0)
    if prior is not None:
        cost = cost + prior_about(prior, centre, np.zeros(3))
    near = np.eye(4) if start is None else as_pose(start, "start")
    free = Freedom.parse("all" if dof is None else dof)
    found = cost.minimise(near=near, dof=free)
    if found.free:
        raise DegenerateGeometryError(
            f"the points leave {', '.join(found.free)}; hold more points along other directions, six at least"
        )
    T = found.T_target_source
    residuals = np.einsum("ij,ij->i", p @ T[:3, :3].T + T[:3, 3] - q, n)
    information, basis = cost.information(T, centre), free.twists(T, near, centre)
    found_points = PointAlignment(T, inverse_within(information, basis), centre, residuals)
    return found_points if free.count == 6 else with_kept(found_points, left_of(information, basis))
