"""One cost for points, planes, lines and directions: a quadratic form of the pose, additive over features.

With ``y = (vec R, t, 1)``, R row by row, every feature costs ``y^T M y``:

=========  ==============================  ====================
feature    cost                            A
=========  ==============================  ====================
point      ``w |R p + t - q|^2``           identity
plane      ``w (n . (R p + t - q))^2``     ``n^T``
line       ``w |A (R p + t - q)|^2``       ``I - d d^T``
direction  ``w |R m - n|^2``               (t does not enter)
=========  ==============================  ====================

so one 13x13 matrix holds any number of them. Coordinates are taken relative to an origin on either side, because the
squares of far-away coordinates would swallow the residuals.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray

# Rows of 13 numbers built in one step: 7 MB.
CHUNK = 65_536


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticForm:
    """Matrix of the cost, relative to an origin on either side.

    Attributes
    ----------
    matrix : ndarray, (13, 13)
        Symmetric; acts on (R row by row, t, 1) with t relative to the origins: ``t + R c_source - c_target``.
    origin_source, origin_target : ndarray, (3,)
        What was subtracted from the coordinates.
    """

    matrix: FloatArray
    origin_source: FloatArray
    origin_target: FloatArray

    def __add__(self, other: QuadraticForm) -> QuadraticForm:
        moved = other.about(self.origin_source, self.origin_target)
        return dataclasses.replace(self, matrix=self.matrix + moved.matrix)

    def about(self, origin_source: FloatArray, origin_target: FloatArray) -> QuadraticForm:
        """The same cost relative to other origins, (3,) each."""
        # t = t' + R (c_s - c_s') - (c_t - c_t'), linear in y'.
        change = np.eye(13)
        change[9:12, :9] = np.kron(np.eye(3), self.origin_source - origin_source)
        change[9:12, 12] = origin_target - self.origin_target
        return QuadraticForm(change.T @ self.matrix @ change, origin_source, origin_target)

    def coordinates(self, T: FloatArray) -> FloatArray:
        """The 13 numbers of a pose T_target_source, (4, 4)."""
        R = T[:3, :3]
        t = T[:3, 3] + R @ self.origin_source - self.origin_target
        return np.concatenate([R.ravel(), t, [1.0]])

    def value(self, T: FloatArray) -> float:
        """Cost of a pose T_target_source, (4, 4)."""
        y = self.coordinates(T)
        return float(y @ self.matrix @ y)


def point_form(p: FloatArray, q: FloatArray, weights: FloatArray, origins: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Matrix of points p to points q, (n, 3) each, relative to the origins.

    Parameters
    ----------
    p, q : ndarray, (n, 3)
        Source and target points.
    weights : ndarray, (n,)
        Weights.
    origins : pair of ndarray, (3,)
        Source and target origin.

    Returns
    -------
    ndarray, (13, 13)
        Symmetric matrix.
    """
    total = np.zeros((7, 7))
    for i in range(0, len(p), CHUNK):
        part = slice(i, i + CHUNK)
        rows = np.hstack([p[part] - origins[0], np.ones((len(p[part]), 1)), q[part] - origins[1]])
        total += (rows * weights[part, None]).T @ rows
    return _isotropic(total)


def direction_form(m: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:
    """Matrix of directions m to directions n, (n, 3) each; no origin enters.

    Parameters
    ----------
    m, n : ndarray, (n, 3)
        Source and target directions.
    weights : ndarray, (n,)
        Weights.

    Returns
    -------
    ndarray, (13, 13)
        Symmetric matrix.
    """
    rows = np.hstack([m, np.zeros((len(m), 1)), n])
    return _isotropic((rows * weights[:, None]).T @ rows)


def plane_form(
    p: FloatArray, q: FloatArray, normals: FloatArray, weights: FloatArray, origins: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Matrix of points p to planes through q with the given normals, (n, 3) each, relative to the origins.

    Parameters
    ----------
    p, q, normals : ndarray, (n, 3)
        Source points, points of the target planes, unit normals.
    weights : ndarray, (n,)
        Weights.
    origins : pair of ndarray, (3,)
        Source and target origin.

    Returns
    -------
    ndarray, (13, 13)
        Symmetric matrix.
    """
    total = np.zeros((13, 13))
    for i in range(0, len(p), CHUNK):
        part = slice(i, i + CHUNK)
        local, n = p[part] - origins[0], normals[part]
        rows = np.hstack(
            [
                (n[:, :, None] * local[:, None, :]).reshape(-1, 9),
                n,
                -np.einsum("ij,ij->i", n, q[part] - origins[1])[:, None],
            ]
        )
        total += (rows * weights[part, None]).T @ rows
    return total


def _isotropic(sums: FloatArray) -> FloatArray:
    """From the sums of (p, 1, q) (p, 1, q)^T: the same 4x4 block for each row of (R, t)."""
    matrix = np.zeros((13, 13))
    for k in range(3):
        own = np.array([3 * k, 3 * k + 1, 3 * k + 2, 9 + k])
        matrix[np.ix_(own, own)] = sums[:4, :4]
        matrix[own, 12] = matrix[12, own] = -sums[:4, 4 + k]
    matrix[12, 12] = np.trace(sums[4:, 4:])
    return matrix
