r"""The least error that measured points and directions allow: the Cramer-Rao bound, and what other weights lose.

Let a model point p be measured as ``q = R p + t + e`` with e Gaussian, sigma_p on each coordinate, and a model
direction m as n, which is ``R m`` tilted by Gaussian angles, sigma_n along each of the two ways across it. Move the
pose by a small turn omega about a place c and a shift tau. A point then moves by

    omega x (x - c) + tau = J (omega, tau),     J = (-[x - c]x, I),     x = R p + t,

and a direction by ``omega x n = -[n]x omega``, always across itself. The log-likelihood is, to second order,
``-|q - x|^2 / (2 sigma_p^2) - |n - R m|^2 / (2 sigma_n^2)`` summed over all matches, so the Fisher information is

    F = sum J^T J / sigma_p^2 + sum diag(I - n n^T, 0) / sigma_n^2,

because ``[n]x^T [n]x = I - n n^T`` for a unit vector. No unbiased estimate of (omega, tau) has a covariance below
``F^-1``. The trace of its first block bounds the mean squared angle of the rotation error, the trace of its last
block that of the place of c.

Weighted least squares with the weights beta and alpha solve, to first order, ``A (omega, tau) = g`` with
``A = sum beta J^T J + sum alpha diag(I - n n^T, 0)``, and g has the covariance B, which is A with beta replaced by
``beta^2 sigma_p^2`` and alpha by ``alpha^2 sigma_n^2``. Their error has the covariance ``A^-1 B A^-1``. For
``beta = 1 / sigma_p^2`` and ``alpha = 1 / sigma_n^2`` (`dqreg.likelihood_weights`) A = B = F: the bound is reached.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import quaternion


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


def cramer_rao(
    points: FloatArray, directions: FloatArray, centre: FloatArray, sigma_p: float, sigma_n: float
) -> FloatArray:
    """Covariance that no unbiased estimate can undercut.

    Shapes: returns (..., 6, 6).
    """
    information = weighted_information(points, directions, centre, sigma_p**-2, sigma_n**-2)
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def covariance_of_weights(
    points: FloatArray,
    directions: FloatArray,
    centre: FloatArray,
    sigmas: tuple[float, float],
    weights: tuple[float, float],
) -> FloatArray:
    """Covariance that weighted least squares reach, ``A^-1 B A^-1``.

    Shapes: returns (..., 6, 6).
    """
    (sigma_p, sigma_n), (beta, alpha) = sigmas, weights
    inverse = np.linalg.inv(weighted_information(points, directions, centre, beta, alpha))
    B = weighted_information(points, directions, centre, (beta * sigma_p) ** 2, (alpha * sigma_n) ** 2)
    return np.asarray(inverse @ B @ inverse)


def rms_of(covariance: FloatArray) -> tuple[float, float]:
    """Root mean square turn and shift of a covariance, or of a mean of several.

    Shapes: covariance (..., 6, 6).
    """
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    turn, shift = variances[..., :3].sum(axis=-1), variances[..., 3:].sum(axis=-1)
    return float(np.sqrt(turn.mean())), float(np.sqrt(shift.mean()))
