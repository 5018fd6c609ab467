"""The cost of a pose from the residuals themselves: one more pass over the matches, exact however small it is."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.solvers.matches import Matches

# Rows a chunk: it stays in the cache and below the size at which BLAS wakes its threads.
CHUNK_ROWS = 3072
# Rows up to which plain expressions are quicker than preparing chunks.
FEW_ROWS = 512


def cost_of_pose(T_target_source: FloatArray, matches: Matches) -> tuple[float, float]:
    """Points' and directions' part of ``sum beta |R p + t - q|^2 + sum alpha |R m - n|^2``.

    Parameters
    ----------
    T_target_source : ndarray, (4, 4)
        Pose to weigh.
    matches : Matches
        Matched points and directions.

    Returns
    -------
    point_cost, direction_cost : float
        Sums of squares, never negative; their sum is the cost.

    Raises
    ------
    InputError
        If the pose is not an ndarray of float64, (4, 4), and not rigid either; the matches are trusted.

    Examples
    --------
    >>> from dqreg.solvers.matches import read_matches
    >>> cost_of_pose(np.eye(4), read_matches([[0, 0, 0], [1, 0, 0]], [[0, 0, 2], [1, 0, 0]]))
    (4.0, 0.0)
    """
    if (
        type(T_target_source) is not np.ndarray
        or T_target_source.dtype != np.float64
        or T_target_source.shape != (4, 4)
    ):
        T_target_source = as_pose(T_target_source, "T_target_source")
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    m = matches
    return (
        _residual_sum(m.points_source, m.points_target, m.point_weights, R, t),
        _residual_sum(m.directions_source, m.directions_target, m.direction_weights, R, None),
    )


def _residual_sum(
    source: FloatArray, target: FloatArray, weights: FloatArray | None, R: FloatArray, t: FloatArray | None
) -> float:
    if not len(source):
        return 0.0
    if len(source) <= FEW_ROWS:
        away = source @ R.T - target if t is None else (source - source[0]) @ R.T - (target - target[0])
        if t is not None:
            away += _miss(source[0], target[0], R, t)
        squares = np.square(away, out=away)
        return float(squares.sum()) if weights is None else float((weights @ squares).sum())
    work = np.zeros((2, min(CHUNK_ROWS, len(source) + len(source) % 2), 3)).reshape(2, -1)
    near = None if t is None else _first_match(source[0], target[0], R, t, len(work[0]))
    # Two rows of three turn as one row of six, at half the price.
    turn, total = np.kron(np.eye(2), R.T), 0.0
    for first in range(0, len(source), CHUNK_ROWS):
        p, q = source[first : first + CHUNK_ROWS].ravel(), target[first : first + CHUNK_ROWS].ravel()
        moved, turned = work[0, : p.size], work[1, : p.size]
        if near is not None:
            p = np.subtract(p, near[0, : p.size], out=moved)
        if p.size % 6 == 0:
            np.matmul(p.reshape(-1, 6), turn, out=turned.reshape(-1, 6))
        else:
            np.matmul(p.reshape(-1, 3), R.T, out=turned.reshape(-1, 3))
        if near is not None:
            q = np.subtract(q, near[1, : q.size], out=moved)
        residual = np.subtract(turned, q, out=turned)
        if near is not None:
            residual += near[2, : q.size]
        if weights is None:
            total += float(np.dot(residual, residual))
        else:
            squared = np.multiply(residual, residual, out=moved).reshape(-1, 3) @ np.ones(3)
            total += float(np.dot(weights[first : first + CHUNK_ROWS], squared))
    return total


def _first_match(a: FloatArray, b: FloatArray, R: FloatArray, t: FloatArray, size: int) -> FloatArray:
    """First match, to be taken from source and target, and its residual, to be added; as often as fills ``size``.

    Far from the origin R p + t would round at the size of the coordinates, and hide the residual.
    """
    return np.tile(np.stack((a, b, _miss(a, b, R, t))), size // 3)


def _miss(a: FloatArray, b: FloatArray, R: FloatArray, t: FloatArray) -> FloatArray:
    """``R a + t - b``, with R - I first: of small rotations of far points nothing is lost."""
    miss: FloatArray = (R - np.eye(3)) @ a + t - (b - a)
    return miss
