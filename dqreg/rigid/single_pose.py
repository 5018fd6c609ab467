"""One pose: its parts, exponential and logarithm, number by number: NumPy on stacks takes up to 30 times as long.

What comes in is known to be rigid; `dqreg.rigid.twist` checks it and takes stacks.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg._rotations import nearest_rotation

# Angle below which the next terms of the series are beyond the last digit.
_SERIES_RAD = 1e-3
_IDENTITY, _NO_ROTATION = np.eye(4), np.eye(3)
# A rotation is nearly one where its columns are orthonormal to this.
_ORTHONORMAL_TOLERANCE = 1e-9


def from_parts(R: FloatArray, t: FloatArray) -> FloatArray:
    """Pose of a rotation and a translation. Shapes: R (3, 3), t (3,), returns (4, 4)."""
    T = _IDENTITY.copy()
    T[:3, :3], T[:3, 3] = R, t
    return T


def orthonormal(T: FloatArray) -> FloatArray:
    """The pose with its rotation made orthogonal to the last digit. Shapes: (4, 4) both."""
    pose, R = T.copy(), T[:3, :3]
    off = R.T @ R - _NO_ROTATION
    if np.abs(off).max() < _ORTHONORMAL_TOLERANCE:
        # What is next in the series of the nearest rotation is below the last digit.
        pose[:3, :3] -= 0.5 * (R @ off)
    else:
        pose[:3, :3] = nearest_rotation(R)
    return pose


def apply(T: FloatArray, points: FloatArray) -> FloatArray:
    """Points, (..., 3), moved by one pose: ``R p + t``."""
    # A contiguous 3x3 and three column sums in place: twice as fast on a million points as `P @ R.T + t`.
    turn = np.ascontiguousarray(T[:3, :3].T)
    moved = product(points, turn) if points.ndim == 2 else points @ turn
    for axis in range(3):
        moved[..., axis] += T[axis, 3]
    return moved


def cross_matrix(x: float, y: float, z: float) -> FloatArray:
    """Matrix of the cross product with one vector from the left, (3, 3)."""
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(twist: FloatArray) -> FloatArray:
    """Pose of one screw motion. Shapes: twist (6,), returns (4, 4)."""
    u, v, w, x, y, z = twist.tolist()
    angle = math.hypot(u, v, w)
    small = angle <= _SERIES_RAD
    one = 1.0 - angle**2 / 6.0 if small else math.sin(angle) / angle
    two = 0.5 - angle**2 / 24.0 if small else 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    three = 1.0 / 6.0 - angle**2 / 120.0 if small else (1.0 - one) / angle**2
    W = cross_matrix(u, v, w)
    square = W @ W
    T = _IDENTITY.copy()
    T[:3, 3] = (T[:3, :3] + two * W + three * square) @ (x, y, z)
    T[:3, :3] += one * W + two * square
    return T


def angle_between(T_a: FloatArray, T_b: FloatArray) -> float:
    """Angle of the rotation that leads from one pose to the other, radians. Shapes: (4, 4) each."""
    (a, b, c), (d, e, f), (g, h, i) = (T_a[:3, :3].T @ T_b[:3, :3]).tolist()
    # Twice the sine and twice the cosine: small angles, and those near pi, keep their digits.
    return math.atan2(math.hypot(h - f, c - g, d - b), a + e + i - 1.0)


def log(R: FloatArray, t: FloatArray) -> FloatArray:
    """Twist of one pose. Shapes: R (3, 3), t (3,), returns (6,)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    x, y, z = t.tolist()
    # The quaternion by its largest component.
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    k = squares.index(max(squares))
    found = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[k]
    length = math.hypot(*found)
    # Of the two signs the one whose first component other than zero is positive: it decides at half-turns.
    sign = math.copysign(1.0, next(value for value in found if value))
    q, p, r, s = (sign * value / length for value in found)
    sine = math.hypot(p, r, s)
    angle = 2.0 * math.atan2(sine, q)
    factor = angle / sine if sine > 0.0 else 2.0
    u, v, w = factor * p, factor * r, factor * s
    # Of the inverse Jacobian ``I - [w x] / 2 + m [w x]^2``, by its series where the sines cancel.
    half = 0.5 * angle
    m = (1.0 - half / math.tan(half)) / angle**2 if angle > _SERIES_RAD else 1.0 / 12.0 + angle**2 / 720.0
    cross = v * z - w * y, w * x - u * z, u * y - v * x
    twice = v * cross[2] - w * cross[1], w * cross[0] - u * cross[2], u * cross[1] - v * cross[0]
    moved = (p - 0.5 * c1 + m * c2 for p, c1, c2 in zip((x, y, z), cross, twice, strict=True))
    return np.array([u, v, w, *moved])
