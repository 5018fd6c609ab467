"""First estimates of AX = XB: by dual quaternions (Daniilidis 1999), and by rotation first; and what leaves X open.

K. Daniilidis, "Hand-eye calibration using dual quaternions", The International Journal of Robotics Research 18 (1999).
The unit dual quaternion ``r + eps s`` of X obeys ``a x = x b`` for the motions a and b, which is linear: six equations
a motion, a null space of dimension two, and in it the two quadrics ``r . r = 1`` and ``r . s = 0``.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._rotations import nearest_rotation
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose, quaternion

# Spread of the rotation vectors off one axis, in units of that along it, which is rounding.
PARALLEL_RATIO = 1e-9
# Rotations that are none, in radians.
STILL_RAD = 1e-9


def starts(A: FloatArray, B: FloatArray) -> list[FloatArray]:
    """Estimates of X, (4, 4) each, for motions whose axes are not all parallel. Shapes: A, B (n, 4, 4)."""
    # Rotations and translations are put into one unit; a distance is as good as an angle then.
    unit = float(np.sqrt(0.5 * (np.square(A[:, :3, 3]).sum() + np.square(B[:, :3, 3]).sum()) / len(A))) or 1.0
    scaled = [motions.copy() for motions in (A, B)]
    for motions in scaled:
        motions[:, :3, 3] /= unit
    found = [by_dual_quaternions(*scaled), by_rotation_first(*scaled)]
    for X in found:
        X[:3, 3] *= unit
    return found


def by_dual_quaternions(A: FloatArray, B: FloatArray) -> FloatArray:
    """X by Daniilidis. Shapes: A, B (n, 4, 4), returns (4, 4)."""
    (a, a_dual), (b, b_dual) = _dual_quaternions(A), _dual_quaternions(B)
    # Either sign is the same motion; the scalar parts of both sides are equal.
    sign = np.where((a[:, :1] * b[:, :1]) < 0.0, -1.0, 1.0)
    b, b_dual = sign * b, sign * b_dual
    rows = np.zeros((len(A), 6, 8))
    rows[:, :3, 0], rows[:, :3, 1:4] = a[:, 1:] - b[:, 1:], quaternion.cross_matrix(a[:, 1:] + b[:, 1:])
    rows[:, 3:, :4] = np.concatenate(
        [(a_dual - b_dual)[:, 1:, None], quaternion.cross_matrix((a_dual + b_dual)[:, 1:])], axis=2
    )
    rows[:, 3:, 4:] = rows[:, :3, :4]
    v8, v7 = _smallest(rows)[:, :2].T
    (r1, s1), (r2, s2) = (v7[:4], v7[4:]), (v8[:4], v8[4:])
    # (x r1 + y r2) . (x s1 + y s2) = 0 for the ratio of x and y; of its two roots, the one with the larger r.
    roots = _ratios(float(r1 @ s1), float(r1 @ s2 + r2 @ s1), float(r2 @ s2))
    r, s = max(((x * r1 + y * r2, x * s1 + y * s2) for x, y in roots), key=lambda pair: float(pair[0] @ pair[0]))
    size = float(np.linalg.norm(r)) or 1.0
    r, s = r / size, s / size
    X = np.eye(4)
    X[:3, :3] = quaternion.to_matrix(r)
    X[:3, 3] = 2.0 * quaternion.multiply(s, quaternion.conjugate(r))[1:]
    return X


def by_rotation_first(A: FloatArray, B: FloatArray) -> FloatArray:
    """X by ``R_A R_X = R_X R_B``, linear in R_X, then the translation. Shapes: A, B (n, 4, 4), returns (4, 4)."""
    # Half-turns have two axes, which the matrices do not see.
    X, R_A, R_B = np.eye(4), A[:, :3, :3], B[:, :3, :3]
    rows = np.einsum("nij,kl->nikjl", R_A, np.eye(3)) - np.einsum("ij,nlk->nikjl", np.eye(3), R_B)
    nearest = _smallest(rows.reshape(len(A), 9, 9))[:, 0].reshape(3, 3)
    X[:3, :3] = nearest_rotation(nearest * np.sign(np.linalg.det(nearest)))
    # (R_A - I) t_X = R_X t_B - t_A
    left, right = R_A - np.eye(3), B[:, :3, 3] @ X[:3, :3].T - A[:, :3, 3]
    normal = np.einsum("nij,nik->jk", left, left)
    X[:3, 3] = np.linalg.lstsq(normal, np.einsum("nij,ni->j", left, right), rcond=None)[0]
    return X


def _smallest(rows: FloatArray) -> FloatArray:
    """Right singular vectors, those of the smallest values first, to half of the digits. Shapes: rows (n, k, m)."""
    # A start needs no more, and large products would wake the threads of BLAS.
    return np.asarray(np.linalg.eigh(np.einsum("nij,nik->jk", rows, rows))[1])


def require_axes(A: FloatArray, noise_rad: float = 0.0) -> None:
    """Raise where motions leave X open: too few, without rotation, or about one axis within the noise."""
    if len(A) < 2:
        raise DegenerateGeometryError(
            f"hand-eye calibration needs two motions with different axes, three stations or more; got {len(A)} motion"
            f"{'s' * (len(A) != 1)}: one motion leaves a rotation about its axis and a translation along it open"
        )
    spread = np.linalg.svd(pose.log(A)[:, :3], compute_uv=False) / np.sqrt(len(A))
    if spread[0] > STILL_RAD and not spread[0] > 3.0 * noise_rad:
        raise DegenerateGeometryError(
            f"the rotations of A and B differ by {np.rad2deg(noise_rad):.3g} degrees rms a component, and A rotates by "
            f"{np.rad2deg(spread[0]):.3g} only: are the poses of one side inverted, or do rows not belong together?"
        )
    if not spread[0] > STILL_RAD:
        raise DegenerateGeometryError(
            f"no motion rotates (by {np.rad2deg(spread[0]):.3g} degrees at most, rms), so the translation of X is not "
            "determined; add motions that rotate, by 30 degrees and more, about two axes that are not parallel"
        )
    if not spread[1] > max(PARALLEL_RATIO * spread[0], 3.0 * noise_rad):
        raise DegenerateGeometryError(
            f"the axes of all rotations are parallel (rotation {np.rad2deg(spread[0]):.3g} degrees rms along one axis, "
            f"{np.rad2deg(spread[1]):.3g} across it), so the translation of X along that axis is not determined; add "
            "motions about an axis across it"
        )


def _dual_quaternions(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    real = quaternion.from_matrix(T[:, :3, :3])
    shift = np.concatenate([np.zeros((len(T), 1)), T[:, :3, 3]], axis=1)
    return real, 0.5 * quaternion.multiply(shift, real)


def _ratios(first: float, mixed: float, last: float) -> list[tuple[float, float]]:
    """Unit pairs (x, y) with ``first x^2 + mixed x y + last y^2 = 0``, or where it is nearest to that."""
    # The roots of a quadratic form are the directions between its eigenvectors; noise may make both values one sign.
    values, vectors = np.linalg.eigh(np.array([[first, 0.5 * mixed], [0.5 * mixed, last]]))
    low, high = max(-float(values[0]), 0.0), max(float(values[1]), 0.0)
    if low + high == 0.0:
        return [(1.0, 0.0), (0.0, 1.0)]
    return [
        (float(pair[0]), float(pair[1]))
        for pair in (np.sqrt(high) * vectors[:, 0] + side * np.sqrt(low) * vectors[:, 1] for side in (1.0, -1.0))
    ]
