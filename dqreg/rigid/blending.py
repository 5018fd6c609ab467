"""Weighted blends of several motions: linear (DLB) and by screws (iterated ScLERP)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import _dual_parts
from dqreg.rigid._mean import shares
from dqreg.rigid.dual_quaternion import DualQuaternion

# Iterations of the blend by screws, which gains some digits with each; and the step at which it ends.
_MAX_STEPS, _CONVERGED_STEP = 100, 1e-13


def blend(
    motions: DualQuaternion, weights: ArrayLike | None = None, *, method: Literal["linear", "screw"] = "linear"
) -> DualQuaternion:
    """Blend motions by weights, whatever their signs (Kavan et al., "Geometric skinning with dual quaternions", 2008).

    Both blends move with the motions: ``blend(a * q * b) = a * blend(q) * b``.

    Parameters
    ----------
    motions : DualQuaternion, (..., n)
        Motions to blend along the last axis of the stack.
    weights : array_like, (..., n), optional
        Weights, not negative; equal ones if not given. n motions with weights (m, n) give m blends.
    method : {"linear", "screw"}
        ``"linear"``: the normalised sum (DLB), fast. ``"screw"``: the motion m at which ``sum w log(m^-1 q)`` is zero
        (DIB, iterated ScLERP); of two motions exactly `DualQuaternion.sclerp`.

    Returns
    -------
    DualQuaternion
        Of shape (...).

    Raises
    ------
    InputError
        If there are no motions, or the weights are negative or all zero.
    DegenerateGeometryError
        If the rotations are so far apart that no blend by screws is found.

    Examples
    --------
    >>> ends = DualQuaternion.from_screw([0, 0, 1], [0.0, 1.0], [0.0, 4.0])
    >>> round(blend(ends, [0.75, 0.25], method="screw").as_screw().distance, 12)
    1.0
    """
    if method not in ("linear", "screw"):
        raise InputError(f'method must be "linear" or "screw"; got {method!r}')
    if not motions.shape or not motions.shape[-1]:
        raise InputError(f"motions must be a stack of at least one; got shape {motions.shape}")
    w = shares(weights, motions.shape[-1])
    linear = _linear(motions, w)
    return linear if method == "linear" else _by_screws(motions, w, linear)


def _linear(motions: DualQuaternion, w: FloatArray) -> DualQuaternion:
    # Signs of the hemisphere of the heaviest: a motion and its negative count as one, and the sum is never zero.
    real, weights = np.broadcast_arrays(motions.real, w[..., np.newaxis])
    heaviest = np.argmax(weights[..., 0], axis=-1)[..., np.newaxis, np.newaxis]
    pole = np.take_along_axis(real, heaviest, axis=-2)
    signed = w * np.where(np.sum(real * pole, axis=-1) < 0.0, -1.0, 1.0)
    total = [np.einsum("...n,...ni->...i", signed, np.broadcast_to(part, real.shape)) for part in (real, motions.dual)]
    return DualQuaternion.from_array(np.concatenate(total, axis=-1), normalize=True)


def _by_screws(motions: DualQuaternion, w: FloatArray, start: DualQuaternion) -> DualQuaternion:
    found = start
    for _ in range(_MAX_STEPS):
        here = found[..., np.newaxis] if found.shape else found
        step = np.einsum("...n,...ni->...i", w, (here.inverse() * motions).log())
        found = found * DualQuaternion.exp(step)
        lengths = np.maximum(np.abs(motions.dual).max(axis=(-2, -1)), _dual_parts.SMALLEST_NUMBER)
        limits = _CONVERGED_STEP * lengths[..., np.newaxis]
        if np.all(np.abs(step[..., :3]) <= _CONVERGED_STEP) and np.all(np.abs(step[..., 3:]) <= limits):
            return found
    raise DegenerateGeometryError("the rotations are too far apart for a blend by screws. Blend fewer, nearer ones")
