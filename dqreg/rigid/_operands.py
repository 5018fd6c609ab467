"""Checks of arguments: arrays whose last axes hold quaternions, triples, rotations or poses.

Every function of this room takes single values and stacks of them, so the leading axes stay free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import (
    MAX_ROTATION_GAP,
    RIGID_TOLERANCE,
    BoolArray,
    FloatArray,
    as_float,
    pose_of,
    require_finite,
    with_last_row,
)
from dqreg._rotations import nearest_rotation
from dqreg.errors import InputError

# What a product of a few rotations departs from orthonormal.
ROTATION_ROUNDING = 1e-14
# Sine of the angle below which two directions are parallel to rounding.
PARALLEL_SIN = 1e-14


def as_quaternions(value: ArrayLike, name: str) -> FloatArray:
    """Quaternions, scalar first, or a SciPy Rotation. Shapes: value (..., 4), returns (..., 4)."""
    write = getattr(value, "as_quat", None)
    if write is not None:
        value = np.roll(write(), 1, axis=-1)  # SciPy writes x, y, z, w
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
    """Rotation matrices, or a SciPy Rotation; rounded ones are projected.

    Shapes: value (..., 3, 3), returns (..., 3, 3).
    """
    if hasattr(value, "as_matrix"):
        value = value.as_matrix()
    R = _with_last_axes(value, name, (3, 3), "3x3 matrices in the last two axes")
    return _nearest(R, _require_rotations(R, name) > RIGID_TOLERANCE)


def _nearest(R: FloatArray, worn: BoolArray) -> FloatArray:
    """Nearest rotations where they are worn, as they are elsewhere: few are, and it costs a hundred looks."""
    if not worn.any():
        return R
    found = R.copy()
    found[worn] = nearest_rotation(R[worn])
    return found


def _require_rotations(R: FloatArray, name: str) -> FloatArray:
    """Raise unless all are rotations; how far each departs from orthonormal. Shapes: R (..., 3, 3), returns (...)."""
    # Column by column: products of many small matrices take four times as long.
    columns = [[R[..., i, j] for i in range(3)] for j in range(3)]
    gap = np.zeros(R.shape[:-2])
    for j, k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)):
        one, two = columns[j], columns[k]
        gap = np.maximum(gap, np.abs(one[0] * two[0] + one[1] * two[1] + one[2] * two[2] - (j == k)))
    if not np.all(gap <= MAX_ROTATION_GAP):
        raise InputError(
            f"{name} must be a rotation; it departs from orthonormal by {np.max(gap):.3g} "
            f"(allowed {MAX_ROTATION_GAP:g}). Remove any scale or shear first"
        )
    (a, b, c), (d, e, f), (g, h, i) = columns
    if np.any(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0):
        raise InputError(f"{name} holds a mirror image (determinant -1); a rotation has +1")
    return gap


def as_poses(value: ArrayLike, name: str) -> FloatArray:
    """Poses, checked for their shape only: the helpers that use this run inside loops.

    Shapes: value (..., 4, 4), returns (..., 4, 4).
    """
    given = pose_of(value)
    T = given if isinstance(given, np.ndarray) and given.dtype == np.float64 else as_float(given, name)
    return _with_last_axes(with_last_row(T), name, (4, 4), "4x4 poses (or 3x4) in the last two axes")


def as_rigid_poses(value: ArrayLike, name: str) -> FloatArray:
    """A stack of poses, checked as `dqreg._arrays.as_pose` checks one, with rotations exact to rounding.

    Shapes: value (..., 4, 4), returns (..., 4, 4).
    """
    T = as_poses(value, name)
    require_finite(T, name)
    if not np.all(np.abs(T[..., 3, :] - [0.0, 0.0, 0.0, 1.0]) <= RIGID_TOLERANCE):
        raise InputError(f"{name} must have the last row 0 0 0 1. Were they transposed?")
    R = T[..., :3, :3]
    gap = _require_rotations(R, name)
    poses = T.copy()
    poses[..., :3, :3] = _nearest(R, gap > ROTATION_ROUNDING)
    poses[..., 3, :] = [0.0, 0.0, 0.0, 1.0]
    return poses


def as_lines(value: ArrayLike, name: str) -> FloatArray:
    """Lines: direction, then moment. Shapes: value (..., 6), returns (..., 6)."""
    return _with_last_axes(value, name, (6,), "direction and moment of a line in the last axis")


def as_planes(value: ArrayLike, name: str) -> FloatArray:
    """Planes a x + b y + c z + d = 0. Shapes: value (..., 4), returns (..., 4)."""
    return _with_last_axes(value, name, (4,), "coefficients a, b, c, d of a plane in the last axis")


def require_meeting(**shapes: tuple[int, ...]) -> None:
    """Raise unless leading axes broadcast."""
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError:
        words = " and ".join(f"{shape} of {name}" for name, shape in shapes.items())
        raise InputError(f"leading axes must broadcast; got {words}. Use [:, None] for each with each") from None


def _with_last_axes(value: ArrayLike, name: str, last: tuple[int, ...], words: str) -> FloatArray:
    # A float64 array passes untouched, whatever its strides: NumPy's operations take it as it is. Masked arrays
    # and matrices have others.
    array = value if type(value) is np.ndarray and value.dtype == np.float64 else as_float(value, name)
    if array.shape[-len(last) :] != last:
        raise InputError(f"{name} must hold {words}; got shape {array.shape}")
    return array
