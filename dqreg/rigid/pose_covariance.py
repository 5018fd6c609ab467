"""Covariances of a pose that a caller gives: what is one, and its inverse where some motions are not known."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, as_float
from dqreg.errors import InputError

# Departure from symmetry, and smallest eigenvalue of the correlations, that rounding may leave.
MAX_ASYMMETRY = 1e-6
MIN_EIGENVALUE = 1e-15


def read_covariance(value: object, name: str, remedy: str = "") -> FloatArray:
    """Covariance of a twist, checked: rotation first, or six variances; infinite where nothing is known.

    Shapes: value (6, 6) or (6,), returns (6, 6).

    >>> read_covariance([1, 1, float("inf"), 4, 4, 4], "covariance")[2:4, 2:4].tolist()
    [[inf, 0.0], [0.0, 4.0]]
    """
    C = as_float(value, name)
    if C.shape == (6,):
        C = np.diag(C)
    if C.shape != (6, 6):
        raise InputError(f"{name} must be a 6x6 matrix, rotation first, or six variances; got shape {C.shape}")
    return np.asarray(_checked(C[None], name, remedy)[0])


def read_covariances(value: object, name: str, count: int, remedy: str = "") -> FloatArray:
    """The same of a stack of matrices. Shapes: value (count, 6, 6), returns (count, 6, 6)."""
    C = as_float(value, name)
    if C.shape != (count, 6, 6):
        raise InputError(f"{name} must have shape ({count}, 6, 6), one each; got {C.shape}")
    return _checked(C, name, remedy)


def _checked(C: FloatArray, name: str, remedy: str) -> FloatArray:
    """Symmetric matrices of a stack, where each is a covariance."""
    said = f". {remedy}" if remedy else ""
    if np.isnan(C).any():
        raise InputError(f"{name} holds NaN; give an infinite variance to what is unknown")
    variances = np.diagonal(C, axis1=-2, axis2=-1)
    if not (variances > 0.0).all():
        least = variances[np.argmin(variances.min(axis=1))].tolist()
        raise InputError(f"{name} must have variances above 0; got {least}{said}")
    unknown = np.isinf(variances)
    own = unknown[:, :, None] & np.eye(6, dtype=bool)
    C = np.where(own, 0.0, C)
    if not np.isfinite(C).all() or C[unknown].any() or np.swapaxes(C, 1, 2)[unknown].any():
        raise InputError(f"{name} must hold finite numbers, and zeros beside an infinite variance")
    size = np.sqrt(np.where(unknown, 1.0, variances))
    correlations = C / size[:, :, None] / size[:, None, :] + own
    uneven = float(np.abs(correlations - np.swapaxes(correlations, 1, 2)).max(initial=0.0))
    if uneven > MAX_ASYMMETRY:
        raise InputError(f"{name} must be symmetric; its correlations differ by {uneven:.3g} across the diagonal")
    least = float(np.linalg.eigvalsh(correlations).min(initial=1.0))
    if not least > MIN_EIGENVALUE:
        raise InputError(
            f"{name} must be positive definite; the smallest eigenvalue of its correlations is {least:.3g}{said}"
        )
    symmetric: FloatArray = np.where(own, np.inf, 0.5 * (C + np.swapaxes(C, 1, 2)))
    return symmetric


def inverse_of_known(block: FloatArray, known: BoolArray) -> FloatArray:
    """Inverse of the known rows and columns, 0 elsewhere. Shapes: block (n, n), known (n,), returns (n, n).

    >>> inverse_of_known(np.diag([4.0, np.inf]), np.array([True, False])).tolist()
    [[0.25, 0.0], [0.0, 0.0]]
    """
    inverse = np.zeros(block.shape)
    if known.any():
        inverse[np.ix_(known, known)] = np.linalg.inv(block[np.ix_(known, known)])
    return inverse
