r"""Cramer-Rao bound of a pose from measured points and directions with known correspondences.

Let a model point p be measured as ``q = R p + t + e`` with e Gaussian, sigma_p on each coordinate, and a model
direction m as n, which is ``R m`` tilted by Gaussian angles, sigma_n along each of the two ways across it. Move the
pose by a small rotation omega about a point c and a translation tau. A point then moves by

    omega x (x - c) + tau = J (omega, tau),     J = (-[x - c]x, I),     x = R p + t,

and a direction by ``omega x n = -[n]x omega``, always across itself. The log-likelihood is, to second order,
``-|q - x|^2 / (2 sigma_p^2) - |n - R m|^2 / (2 sigma_n^2)`` summed over all correspondences, so the Fisher information
is

    F = sum J^T J / sigma_p^2 + sum diag(I - n n^T, 0) / sigma_n^2,

because ``[n]x^T [n]x = I - n n^T`` for a unit vector. No unbiased estimate of (omega, tau) has a covariance below
``F^-1``. The trace of its first block bounds the mean squared angle of the rotation error, the trace of its last
block that of the position of c.

Weighted least squares with the weights beta and alpha solve, to first order, ``A (omega, tau) = g`` with
``A = sum beta J^T J + sum alpha diag(I - n n^T, 0)``, and g has the covariance B, which is A with beta replaced by
``beta^2 sigma_p^2`` and alpha by ``alpha^2 sigma_n^2``. Their error has the covariance ``A^-1 B A^-1``. For
``beta = 1 / sigma_p^2`` and ``alpha = 1 / sigma_n^2`` (`dqreg.likelihood_weights`) A = B = F: the bound is reached.
"""

from __future__ import annotations

import numbers

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import quaternion


def cramer_rao(
    points: ArrayLike,
    directions: ArrayLike | None = None,
    centre: ArrayLike | None = None,
    sigma_p: float = 1.0,
    sigma_n: float = 1.0,
) -> FloatArray:
    """Covariance of the pose that no unbiased estimate from these matches can undercut.

    Parameters
    ----------
    points : array_like, (..., n, 3)
        Points where they are measured, without noise: target frame.
    directions : array_like, (..., m, 3), optional
        Directions there, of unit length. Default: none.
    centre : array_like, (..., 3), optional
        Point that the increment turns about, c. Default: the mean of the points.
    sigma_p : float
        Noise of each coordinate of a point, a length.
    sigma_n : float
        Noise of a direction in radians, along each of the two ways that it can tilt.

    Returns
    -------
    ndarray, (..., 6, 6)
        Of the left increment ``T_true = about(exp(twist), c) @ T``, in the target frame: rotation vector in radians
        first, then translation; the frame of `Fit.covariance`.

    Raises
    ------
    InputError
        If a shape or a number is wrong.
    DegenerateGeometryError
        If the matches leave part of the pose undetermined.

    Examples
    --------
    >>> corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    >>> cramer_rao(corners, sigma_p=0.1).diagonal().round(9).tolist()
    [0.000625, 0.000625, 0.000625, 0.00125, 0.00125, 0.00125]
    """
    p = _triples(points, "points")
    if not p.shape[-2]:
        raise InputError(f"points must have shape (..., n, 3) with n > 0; got shape {p.shape}")
    n = np.zeros((*p.shape[:-2], 0, 3)) if directions is None else _triples(directions, "directions")
    if n.ndim > p.ndim or np.broadcast_shapes(n.shape[:-2], p.shape[:-2]) != p.shape[:-2]:
        raise InputError(f"directions must have the leading axes of points or fewer; got {n.shape} and {p.shape}")
    c = p.mean(axis=-2) if centre is None else _centres(centre, p.shape[:-2])
    given: tuple[object, object] = sigma_p, sigma_n
    if not all(isinstance(sigma, numbers.Real) and float(sigma) > 0.0 for sigma in given):
        raise InputError(f"sigma_p and sigma_n must be above zero; got {sigma_p!r} and {sigma_n!r}")
    information = weighted_information(p, n, c, sigma_p**-2, sigma_n**-2)
    try:
        return np.asarray(np.linalg.inv(information), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise DegenerateGeometryError(
            "these points and directions leave part of the pose undetermined, so that there is no bound; add a point "
            "off their line or a direction across it"
        ) from None


def _centres(value: ArrayLike, leading: tuple[int, ...]) -> FloatArray:
    """Points that the increments turn about, one for all or one a problem. Shapes: returns (..., 3)."""
    array, wanted = as_float(value, "centre"), (*leading, 3)
    require_finite(array, "centre")
    if array.shape[-1:] != (3,) or any(n not in (1, m) for n, m in zip(array.shape[::-1], wanted[::-1], strict=False)):
        raise InputError(f"centre must have shape {wanted}, or (3,); got shape {array.shape}")
    return array


def _triples(value: ArrayLike, name: str) -> FloatArray:
    array = as_float(value, name)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise InputError(f"{name} must have shape (..., n, 3); got shape {array.shape}")
    require_finite(array, name)
    return array


def weighted_information(
    points: FloatArray, directions: FloatArray, centre: FloatArray, beta: float, alpha: float
) -> FloatArray:
    """Sum ``beta J^T J + alpha diag(I - n n^T, 0)`` over points and directions.

    Shapes: points (..., n, 3), directions (..., m, 3), returns (..., 6, 6).
    """
    away = points - np.asarray(centre)[..., np.newaxis, :]
    J = np.concatenate([-quaternion.cross_matrix(away), np.broadcast_to(np.eye(3), (*away.shape, 3))], axis=-1)
    total = beta * np.einsum("...nki,...nkj->...ij", J, J)
    across = np.eye(3) * directions.shape[-2] - np.einsum("...ni,...nj->...ij", directions, directions)
    total[..., :3, :3] += alpha * across
    return np.asarray(total)


def covariance_of_weights(
    points: FloatArray,
    directions: FloatArray,
    centre: FloatArray,
    sigmas: tuple[float, float],
    weights: tuple[float, float],
) -> FloatArray:
    """Covariance that weighted least squares reach, ``A^-1 B A^-1``. Shapes: returns (..., 6, 6)."""
    (sigma_p, sigma_n), (beta, alpha) = sigmas, weights
    inverse = np.linalg.inv(weighted_information(points, directions, centre, beta, alpha))
    B = weighted_information(points, directions, centre, (beta * sigma_p) ** 2, (alpha * sigma_n) ** 2)
    return np.asarray(inverse @ B @ inverse)


def rms_of(covariance: FloatArray) -> tuple[float, float]:
    """Root mean square rotation and translation of a covariance, or of a mean of several.

    Shapes: covariance (..., 6, 6).
    """
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    turn, shift = variances[..., :3].sum(axis=-1), variances[..., 3:].sum(axis=-1)
    return float(np.sqrt(turn.mean())), float(np.sqrt(shift.mean()))
