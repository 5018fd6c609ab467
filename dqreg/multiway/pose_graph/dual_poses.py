"""Many poses as unit dual quaternions, (n, 8): real part, dual part, scalars first. Products row by row."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, quaternion
from dqreg.rigid.rotations import left_jacobian, left_jacobian_inverse


def from_matrices(T: FloatArray) -> FloatArray:
    """Dual quaternions of poses. Shapes: T (..., 4, 4), returns (..., 8)."""
    return _with_translation(quaternion.from_matrix(T[..., :3, :3]), T[..., :3, 3])


def to_matrices(dq: FloatArray) -> FloatArray:
    """Poses of dual quaternions. Shapes: dq (..., 8), returns (..., 4, 4)."""
    return pose.from_parts(quaternion.to_matrix(dq[..., :4]), _translation(dq))


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """The motions b followed by a, kept on the constraints."""
    real = quaternion.multiply(a[..., :4], b[..., :4])
    dual = quaternion.multiply(a[..., :4], b[..., 4:]) + quaternion.multiply(a[..., 4:], b[..., :4])
    real = real / np.linalg.norm(real, axis=-1, keepdims=True)
    dual = dual - np.sum(real * dual, axis=-1, keepdims=True) * real
    return np.concatenate([real, dual], axis=-1)


def inverse(dq: FloatArray) -> FloatArray:
    """The motions back: both quaternions conjugated."""
    return np.asarray(dq * np.array([1.0, -1.0, -1.0, -1.0] * 2))


def exp(twists: FloatArray) -> FloatArray:
    """Dual quaternions of twists, rotation first. Shapes: twists (..., 6), returns (..., 8)."""
    w, v = twists[..., :3], twists[..., 3:]
    half = np.concatenate([np.zeros((*w.shape[:-1], 1)), 0.5 * w], axis=-1)
    return _with_translation(quaternion.exp(half), (left_jacobian(w) @ v[..., None])[..., 0])


def log(dq: FloatArray) -> FloatArray:
    """Twists of dual quaternions, rotations of at most pi. Shapes: dq (..., 8), returns (..., 6)."""
    real = quaternion.canonical(dq[..., :4])
    # The canonical sign has a positive scalar, so that the shorter rotation is taken.
    w = 2.0 * quaternion.log(real)[..., 1:]
    return np.concatenate([w, (left_jacobian_inverse(w) @ _translation(dq)[..., None])[..., 0]], axis=-1)


def _with_translation(real: FloatArray, t: FloatArray) -> FloatArray:
    moved = np.concatenate([np.zeros((*t.shape[:-1], 1)), 0.5 * t], axis=-1)
    return np.concatenate([real, quaternion.multiply(moved, real)], axis=-1)


def _translation(dq: FloatArray) -> FloatArray:
    product: FloatArray = 2.0 * quaternion.multiply(dq[..., 4:], quaternion.conjugate(dq[..., :4]))
    return product[..., 1:]
