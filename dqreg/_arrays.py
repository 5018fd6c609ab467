"""Validation at the door: turn what a caller gave into checked float64 arrays, or say what is wrong.

Inside the package the types are trusted; every public function checks its arrays here, once.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._rotations import nearest_rotation
from dqreg.errors import InputError, warn_of_old_name

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# A rotation read from a text file with seven digits is good to about 1e-6.
RIGID_TOLERANCE = 1e-5
# Rotations that people round to two or three digits depart from orthonormal by up to this, a scale of 1 % by twice it.
MAX_ROTATION_GAP = 1e-2
# Lengths within this of zero, and sizes above its inverse, can be squared and squared again in float64.
MAX_LENGTH = 1e60
# How classes of poses give their matrix.
MATRICES = ("as_matrix", "matrix", "homogeneous", "T_target_source", "transformation")
# Points that stand side by side where three numbers a row are too few for NumPy to be quick about.
WIDE_POINTS = 256
# Points that are few: a copy of their columns is made sooner.
FEW_POINTS = 2_048
# Multiplications of one product that BLAS leaves to one thread.
PIECE_PRODUCTS = 2**18
# Numbers of one dot product that it leaves to one thread.
PIECE_NUMBERS = 8_192


def bounds(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates of points, each (3,). Along rows of three NumPy takes ten times as long."""
    whole = len(points) - len(points) % WIDE_POINTS if len(points) > FEW_POINTS else 0
    rest = np.ascontiguousarray(points[whole:].T)
    if not whole:
        return rest.min(axis=1), rest.max(axis=1)
    # Many points side by side are one long row, and along those it is quick without a copy.
    rows = np.ascontiguousarray(points[:whole]).reshape(-1, 3 * WIDE_POINTS)
    lows, highs = rows.min(axis=0).reshape(WIDE_POINTS, 3), rows.max(axis=0).reshape(WIDE_POINTS, 3)
    low, high = lows.min(axis=0), highs.max(axis=0)
    return (np.minimum(low, rest.min(axis=1)), np.maximum(high, rest.max(axis=1))) if rest.size else (low, high)


def median(values: FloatArray) -> float:
    """Median of finite numbers, (n,), NaN of none: the bits of NumPy's, which takes several times as long."""
    count, half = len(values), len(values) // 2
    if count < 2:
        return float(values[0]) if count else float("nan")
    # Of two places at once NumPy takes a quarter of the time that it takes of one.
    low, high = np.partition(values, (half - 1, half))[half - 1 : half + 1].tolist()
    return float(high if count % 2 else 0.5 * (low + high))


def quantile(values: FloatArray, share: float) -> float:
    """Quantile of finite numbers, (n,), between the two nearest: the bits of NumPy's in a fraction of the time.

    NaN of none.
    """
    if not len(values):
        return float("nan")
    place = share * (len(values) - 1)
    below = int(place)
    above, part = min(below + 1, len(values) - 1), place - below
    ordered = np.partition(values, (below, above))
    low, high = float(ordered[below]), float(ordered[above])
    # From the nearer of the two.
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1.0 - part)


def shifted(points: FloatArray, offset: FloatArray) -> FloatArray:
    """Points moved by one offset: ``points + offset``, three times as fast."""
    moved = np.zeros((len(points), 3))
    whole = len(points) - len(points) % WIDE_POINTS
    rows = np.ascontiguousarray(points[:whole]).reshape(-1, 3 * WIDE_POINTS)
    np.add(rows, np.tile(offset, WIDE_POINTS), out=moved[:whole].reshape(-1, 3 * WIDE_POINTS))
    np.add(points[whole:], offset, out=moved[whole:])
    return moved


def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """``left @ right`` in pieces so small that BLAS wakes no threads, which spin for 30 ms; nor do bits follow them."""
    (m, k), n = left.shape, right.shape[1]
    step = max(PIECE_PRODUCTS * max(m, k, n) // max(m * k * n, 1), 1)
    if max(m, k, n) <= step:
        return np.asarray(left @ right)
    pieces = range(0, max(m, k, n), step)
    if k >= max(m, n):
        return np.asarray(sum(left[:, i : i + step] @ right[i : i + step] for i in pieces))
    found = np.zeros((m, n))
    for i in pieces:
        some = (slice(i, i + step), slice(None)) if m >= n else (slice(None), slice(i, i + step))
        found[some] = left[some[0]] @ right[:, some[1]]
    return found


def dot(left: FloatArray, right: FloatArray) -> float:
    """``left @ right`` of vectors, (n,), without the threads of BLAS, which more than a piece would wake."""
    return float(np.dot(left, right) if len(left) <= PIECE_NUMBERS else np.einsum("i,i", left, right))


def share_of(mask: BoolArray) -> float:
    """Share of a mask, (n,), that is true; NaN of none. `np.mean` takes three times as long."""
    return int(np.count_nonzero(mask)) / len(mask) if len(mask) else float("nan")


def root_mean_square(values: FloatArray) -> float:
    """Of numbers, (n,), one at least."""
    return math.sqrt(dot(values, values) / len(values))


def as_float(value: Any, name: str, kinds: str = "fiubO") -> FloatArray:
    """Float64 array of what was given, which has to be of some kinds of NumPy's types."""
    try:
        if isinstance(value, np.ma.MaskedArray):
            # NumPy would hand out what stands behind the mask.
            value = np.ma.filled(value.astype(np.float64), np.nan)
        array = np.asarray(value)
        if array.dtype.kind not in kinds:
            raise TypeError(f"NumPy type {array.dtype}")
        # NumPy would read None as NaN without a word.
        if array.dtype.kind == "O" and any(item is None for item in array.flat):
            raise TypeError("it holds None")
        # The cast of a signalling NaN, or of a number beyond float64, warns; what is not finite is looked for later.
        with np.errstate(invalid="ignore", over="ignore"):
            return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError.of(f"must be an array of real numbers; got {_words_of(value, error)}", name=name) from error


def _words_of(value: Any, error: Exception) -> str:
    if isinstance(value, (str, os.PathLike)) and Path(value).suffix:
        return f"{str(value)!r:.80}; a file is read by dqreg.geometry.as_geometry"
    if isinstance(value, tuple) and list(map(np.shape, value)) == [(3, 3), (3,)]:
        return "a pair (R, t), which goes in as dqreg.rigid.pose.from_parts(R, t)"
    return f"{type(value).__name__} ({error})"


def as_vectors(value: Any, name: str, *, finite: bool = True) -> FloatArray:
    """Rows of three numbers, (n, 3)."""
    array = as_float(value, name, "fiuO")
    if array.ndim != 2 or array.shape[1] != 3:
        remedy = ""
        if array.ndim == 2 and array.shape[0] == 3 and array.shape[1] > 6:
            remedy = "; where each column is a point, pass array.T"
        elif array.ndim == 2 and array.shape[1] > 3:
            remedy = "; where the first three columns are x, y, z, pass array[:, :3]"
        elif array.ndim == 3 and array.shape[2] == 3:
            remedy = "; an image of points goes in as array.reshape(-1, 3)"
        wanted = f"must have shape (n, 3), one x, y, z row per item; got shape {array.shape}{remedy}"
        raise InputError.of(wanted, name=name)
    if finite:
        require_finite(array, name)
    return array


def as_place(value: Any, name: str) -> FloatArray:
    """One point, (3,)."""
    array = as_float(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be three finite coordinates, x, y and z; got {value!r:.80}")
    return array


def as_weights(value: Any, name: str, count: int) -> FloatArray:
    """One finite weight >= 0 for each of ``count`` items. Shapes: returns (count,)."""
    array = as_float(value, name)
    if array.ndim == 0:
        array = np.full(count, float(array))
    if array.shape != (count,):
        raise InputError(f"{name} must be one number or {count} numbers, one per item; got shape {array.shape}")
    require_finite(array, name)
    if count and array.min() < 0.0:
        raise InputError(f"{name} must not be negative; the smallest is {array.min():g}. Use 0 to leave an item out")
    return array


def as_pose(value: Any, name: str, limit: float = MAX_ROTATION_GAP) -> FloatArray:
    """Rigid 4x4 pose, of numbers (4x4 or 3x4) or an object that writes itself as a matrix.

    The rotation is the one nearest to what was given: rounded numbers are no rotation.
    """
    given = as_float(pose_of(value), name)
    T = with_last_row(given)
    if T.shape != (4, 4):
        is_rotation = given.shape == (3, 3)
        remedy = "; a rotation R alone goes in as dqreg.rigid.pose.from_parts(R, [0, 0, 0])" if is_rotation else ""
        raise InputError(f"{name} must be a 4x4 matrix, or its first three rows (3x4); got shape {given.shape}{remedy}")
    require_finite(T, name)
    if T[3].tolist() != [0.0, 0.0, 0.0, 1.0] and np.abs(T[3] - [0.0, 0.0, 0.0, 1.0]).max() > RIGID_TOLERANCE:
        remedy = ". Was it transposed?" if np.abs(T[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() <= RIGID_TOLERANCE else ""
        raise InputError(f"{name} must have the last row 0 0 0 1; got {T[3].tolist()}{remedy}")
    R = T[:3, :3]
    # Numbers near float64's limit overflow to infinity or NaN, and neither is within the tolerance.
    with np.errstate(over="ignore", invalid="ignore"):
        determinant = np.linalg.det(R)
        gap = np.abs(R.T @ R - np.eye(3)).max()
    if determinant < 0.0:
        raise InputError(f"{name} holds a mirror image (determinant {determinant:.6g}); a rigid pose has +1")
    if not gap <= limit:
        off = f"its rotation block departs from orthonormal by {gap:.3g} (allowed {limit:g})"
        raise InputError(f"{name} is not rigid: {off}. Remove any scale or shear first")
    far = np.abs(T[:3, 3]).max()
    if far > MAX_LENGTH:
        raise InputError(f"{name} moves by {far:.3g}; lengths beyond {MAX_LENGTH:g} cannot be worked with")
    pose = T.copy()
    pose[:3, :3] = nearest_rotation(R)
    pose[3] = [0.0, 0.0, 0.0, 1.0]
    return pose


def departure(value: Any, pose: FloatArray) -> float:
    """How far the rotation of a pose that was given lies from the one that `as_pose` made of it (Frobenius norm)."""
    return float(np.linalg.norm(as_float(pose_of(value), "pose")[:3, :3] - pose[:3, :3]))


def with_last_row(poses: FloatArray) -> FloatArray:
    """Poses without their last row get it; all else as it is. Shapes: poses (..., 3, 4), returns (..., 4, 4)."""
    if poses.shape[-2:] != (3, 4):
        return poses
    last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*poses.shape[:-2], 1, 4))
    return np.concatenate([poses, last], axis=-2)


def pose_of(value: Any) -> Any:
    """Matrix of a pose that is an object (SciPy, gtsam, Sophus, Pinocchio, dqreg, tensors); all else as it is.

    Shapes: returns (..., 4, 4) of such an object.
    """
    if isinstance(value, np.ndarray):
        return value
    # SciPy and dqreg; gtsam and Sophus; Pinocchio; results of dqreg and small_gicp; results of Open3D.
    written = next((found for word in MATRICES if (found := getattr(value, word, None)) is not None), None)
    if written is None:
        return value.numpy() if hasattr(value, "numpy") else value  # NumPy itself cannot read Open3D's tensors
    matrix = np.asarray(pose_of(written() if callable(written) else written))  # a tensor, for one
    if matrix.shape[-2:] != (3, 3):
        return matrix
    T = np.zeros((*matrix.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., 3, 3] = matrix, 1.0
    return T


def require_finite(array: FloatArray, name: str) -> None:
    """Raise unless every number is finite."""
    # One sum is three times faster than a look at each number, which decides where that sum is not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(array.sum()):
            return
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError.of(f"holds {int(bad.sum())} numbers that are NaN or infinite, the first at {first}", name=name)


def require_workable(points: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates; raise if lengths are so large or so small that float64 cannot square them.

    >>> require_workable(np.array([[1e300, 0.0, 0.0]]), "points")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    dqreg.errors.InputError: points hold coordinates up to 1e+300, and lengths beyond 1e+60 cannot be worked with; ...
    """
    low, high = bounds(points)
    require_workable_ends(low, high, name)
    return low, high


def require_workable_ends(low: FloatArray, high: FloatArray, name: str) -> None:
    """The same, where the lowest and highest coordinates, (3,), are known."""
    far = float(max(-low.min(), high.max()))
    if far > MAX_LENGTH:
        wanted = f"hold coordinates up to {far:.3g}, and lengths beyond {MAX_LENGTH:g} cannot be worked with; remove "
        remedy = "those rows (is it a mark for a missing measurement?), or use a larger unit"
        raise InputError.of(wanted + remedy, name=name)
    extent = float((high - low).max())
    if 0.0 < extent < 1.0 / MAX_LENGTH:
        wanted = f"differ by {extent:.3g} at most, too little to work with; give them in a finer unit"
        raise InputError.of(wanted, name=name)


def renamed(old: str, old_value: Any, new: str, new_value: Any, default: Any) -> Any:
    """Value of an argument that may come under its old name, where None is none."""
    if old_value is None:
        return new_value
    if new_value != default:
        raise InputError(f"{old} is the old name of {new}; give {new} alone, got {new_value!r} and {old_value!r}")
    warn_of_old_name(old, new)
    return old_value
