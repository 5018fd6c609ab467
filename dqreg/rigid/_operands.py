"""Checks of arguments: arrays whose last axes hold quaternions, triples, rotations or poses.

Every function of this room takes single values and stacks of them, so the leading axes stay free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import RIGID_TOLERANCE, FloatArray, as_float
from dqreg.errors import InputError


def as_quaternions(value: ArrayLike, name: str) -> FloatArray:
    """Quaternions, scalar first. Shapes: value (..., 4), returns (..., 4)."""
    return _with_last_axes(value, name, (4,), "quaternions w, x, y, z in the last axis")


def as_unit_quaternions(value: ArrayLike, name: str) -> FloatArray:
    """Quaternions of norm 1, as given: a length that is off is reported, never mended.

    Shapes: value (..., 4), returns (..., 4).
    """
    array = as_quaternions(value, name)
    off = np.abs(np.linalg.norm(array, axis=-1) - 1.0)
    # The comparison is written so that NaN fails it.
    if not np.all(off <= RIGID_TOLERANCE):
        raise InputError(
            f"{name} must have norm 1; the norm is off by {np.max(off):.3g} (allowed {RIGID_TOLERANCE:g}). "
            "Use quaternion.normalize first if only its direction counts"
        )
    return array


def as_triples(value: ArrayLike, name: str) -> FloatArray:
    """Vectors of three numbers. Shapes: value (..., 3), returns (..., 3)."""
    return _with_last_axes(value, name, (3,), "x, y, z in the last axis")


def as_directions(value: ArrayLike, name: str) -> FloatArray:
    """Directions as unit vectors: only the direction counts, so a length other than 1 is no fault.

    Shapes: value (..., 3), returns (..., 3).
    """
    array = as_triples(value, name)
    # Divided by the largest component first, so that the squares neither overflow nor vanish.
    largest = np.max(np.abs(array), axis=-1, keepdims=True)
    if not np.all((largest > 0.0) & np.isfinite(largest)):
        raise InputError(f"{name} must have a direction; got a vector that is zero or not finite")
    scaled = array / largest
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))


def as_rotations(value: ArrayLike, name: str) -> FloatArray:
    """Rotation matrices, as given. Shapes: value (..., 3, 3), returns (..., 3, 3)."""
    R = _with_last_axes(value, name, (3, 3), "3x3 matrices in the last two axes")
    gap = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3))
    if not np.all(gap <= RIGID_TOLERANCE):
        raise InputError(
            f"{name} must be a rotation; it departs from orthonormal by {np.max(gap):.3g} "
            f"(allowed {RIGID_TOLERANCE:g}). Remove any scale or shear first"
        )
    if np.any(np.linalg.det(R) < 0.0):
        raise InputError(f"{name} holds a mirror image (determinant -1); a rotation has +1")
    return R


def as_poses(value: ArrayLike, name: str) -> FloatArray:
    """Poses, checked for their shape only: the helpers that use this run inside loops.

    Shapes: value (..., 4, 4), returns (..., 4, 4).
    """
    return _with_last_axes(value, name, (4, 4), "4x4 poses in the last two axes")


def _with_last_axes(value: ArrayLike, name: str, last: tuple[int, ...], words: str) -> FloatArray:
    # A float64 array passes untouched, whatever its strides: NumPy's operations take it as it is.
    array = value if isinstance(value, np.ndarray) and value.dtype == np.float64 else as_float(value, name)
    if array.shape[-len(last) :] != last:
        raise InputError(f"{name} must hold {words}; got shape {array.shape}")
    return array
