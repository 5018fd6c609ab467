"""The pose of least cost in 50 digits, from the float64 numbers as they are: what no rounding of a solver enters."""

from __future__ import annotations

import mpmath as mp
import numpy as np

from dqreg._arrays import FloatArray

DIGITS = 50
EPS = float(np.finfo(np.float64).eps)


def _matrix(rows: FloatArray) -> mp.matrix:
    return mp.matrix([[mp.mpf(float(x)) for x in row] for row in rows])


def best_rotation(points, directions=None, beta=None, alpha=None) -> mp.matrix:
    """Rotation of least cost, (3, 3), for points and directions given as pairs (source, target)."""
    with mp.workdps(DIGITS):
        H = mp.zeros(3, 3)
        if points is not None:
            p, q = (_matrix(side) for side in points)
            w = [mp.mpf(1)] * p.rows if beta is None else [mp.mpf(float(x)) for x in beta]
            p, q = _centred(p, w), _centred(q, w)
            H += _cross(p, q, w)
        if directions is not None:
            m, n = (_matrix(side) for side in directions)
            H += _cross(m, n, [mp.mpf(1)] * m.rows if alpha is None else [mp.mpf(float(x)) for x in alpha])
        S = H.T
        N = mp.matrix(4, 4)
        N[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            N[0, i + 1] = N[i + 1, 0] = S[j, k] - S[k, j]
            N[i + 1, i + 1] = S[i, i] - S[j, j] - S[k, k]
            N[i + 1, j + 1] = N[j + 1, i + 1] = S[i, j] + S[j, i]
        values, vectors = mp.eigsy(N)
        w, x, y, z = vectors[:, max(range(4), key=lambda i: values[i])]
        return mp.matrix(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )


def angle_between(R: FloatArray, exact: mp.matrix) -> float:
    """Angle of ``R^T exact`` in radians, right for the smallest too; R is orthonormal to rounding only."""
    with mp.workdps(DIGITS):
        D = _matrix(R).T * exact
        v = [D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]
        return float(mp.sqrt(sum(x * x for x in v)) / 2)


def _centred(rows: mp.matrix, weights: list[mp.mpf]) -> mp.matrix:
    total = sum(weights)
    mean = [sum(weights[i] * rows[i, k] for i in range(rows.rows)) / total for k in range(3)]
    return mp.matrix([[rows[i, k] - mean[k] for k in range(3)] for i in range(rows.rows)])


def _cross(source: mp.matrix, target: mp.matrix, weights: list[mp.mpf]) -> mp.matrix:
    return mp.matrix(
        [
            [sum(weights[i] * target[i, a] * source[i, b] for i in range(source.rows)) for b in range(3)]
            for a in range(3)
        ]
    )


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """A rotation drawn evenly, (3, 3)."""
    Q, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.diag(upper))
    return Q * np.sign(np.linalg.det(Q))
