"""Mean of rotations: Markley, Cheng, Crassidis and Oshman, "Averaging quaternions" (2007)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid._algebra import canonical
from dqreg.rigid._operands import as_unit_quaternions

# Relative gap of the two largest eigenvalues within which every rotation between two is as good a mean.
_SMALLEST_GAP = 1e-12


def mean(q: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    """Mean rotation: of all unit quaternions the one with the largest ``sum w (q . q_i)^2``, whatever their signs.

    It minimises the sum of ``w |R - R_i|^2`` over rotation matrices too.

    Parameters
    ----------
    q : array_like, (..., n, 4)
        Unit quaternions, scalar first.
    weights : array_like, (..., n), optional
        Weights, not negative; equal ones if not given.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions in canonical sign.

    Raises
    ------
    InputError
        If there are none, or the weights are negative or all zero.
    DegenerateGeometryError
        If they do not determine a mean: two rotations half a turn apart, or all directions alike.

    Examples
    --------
    Three rotations about z, one of them written with the other sign:

    >>> half = np.array([0.1, 0.2, 0.6]) / 2
    >>> q = np.array([1, -1, 1])[:, None] * np.column_stack([np.cos(half), 0 * half, 0 * half, np.sin(half)])
    >>> round(2 * float(np.arccos(mean(q)[0])), 3)
    0.299
    """
    array = as_unit_quaternions(q, "q")
    if array.ndim < 2 or not array.shape[-2]:
        raise InputError(f"q must hold at least one quaternion, (n, 4); got shape {array.shape}")
    w = shares(weights, array.shape[-2])
    moments = np.einsum("...n,...ni,...nj->...ij", w, array, array)
    values, vectors = np.linalg.eigh(moments)
    if np.any(values[..., 3] - values[..., 2] <= _SMALLEST_GAP):
        raise DegenerateGeometryError(
            "the rotations have no mean: two are half a turn apart, or they lie all around. Use weights that prefer one"
        )
    return canonical(vectors[..., 3])


def shares(weights: ArrayLike | None, count: int) -> FloatArray:
    """Weights that add up to one. Shapes: weights (..., count), returns (..., count)."""
    if weights is None:
        return np.full(count, 1.0 / count)
    w = as_float(weights, "weights")
    if w.shape[-1:] != (count,):
        raise InputError(f"weights must hold {count} numbers in the last axis, one each; got shape {w.shape}")
    require_finite(w, "weights")
    largest = np.max(w, axis=-1, keepdims=True)
    if np.any(w < 0.0) or np.any(largest == 0.0):
        raise InputError("weights must not be negative, nor all zero")
    scaled = w / largest  # so that the sum neither overflows nor vanishes
    return np.asarray(scaled / np.sum(scaled, axis=-1, keepdims=True))
