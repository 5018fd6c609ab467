"""Motions of scans, alone and together, that next to no face holds against the others.

Each scan of a group may be held by hundreds of points that it shares with the rest of it, and the group as a whole by a
few at a rim or a round, which no scan alone shows. Such points fit wherever the group is: they have chosen their planes
by the poses that they were found at.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sparse

from dqreg._arrays import BoolArray, FloatArray

# Square by which all scans move, in that by which they move apart.
COMMON_SHARE = 1e-6


def without_loose_motions(
    matrix: sparse.csc_matrix, to_length: FloatArray, shared: BoolArray, least: float
) -> sparse.csc_matrix:
    """What counts of increments: all but what moves scans that share faces apart past fewer points than the least.

    They are looked for among motions of few points for how far all scans move apart: the drift along a chain of well
    held ones is none. What moves all scans alike counts; if not, they would drift away from those that stay. The matrix
    is in points that face a motion. Shapes: matrix and returns (6 n, 6 n), to_length (n, 6, 6) from increments to
    lengths, shared (n, n): Scans that see a face in common.
    """
    back = sparse.block_diag(list(np.linalg.inv(to_length)), format="csc")
    apart = _apart(to_length, shared) @ back
    points, squares = (back.T @ matrix @ back).toarray(), (apart.T @ apart).toarray()
    squares += COMMON_SHARE * np.eye(len(squares))
    held, motions = scipy.linalg.eigh(points, squares, subset_by_value=(-np.inf, least))
    lengths = ((apart @ motion).reshape(-1, 6) for motion in motions.T)
    farthest = np.array([(length**2).sum(axis=1).max(initial=0.0) for length in lengths])
    loose = motions[:, (farthest > COMMON_SHARE) & (held < least * farthest)]
    whole = sparse.identity(len(points), format="csc")
    if not loose.shape[1]:
        return whole
    # All others are at right angles to them in these squares.
    return sparse.csc_matrix(whole - (back @ loose) @ ((squares @ loose).T @ sparse.block_diag(list(to_length))))


def _apart(to_length: FloatArray, shared: BoolArray) -> sparse.csr_matrix:
    """From increments to how scans move apart that see a face in common, in lengths of either, (6 p, 6 n)."""
    rows, columns = np.nonzero(shared & ~np.eye(len(shared), dtype=bool))
    pairs, there = np.arange(len(rows) + 1), to_length[rows]
    ends = (sparse.bsr_matrix((there, k, pairs), shape=(6 * len(rows), 6 * len(shared))) for k in (rows, columns))
    return sparse.csr_matrix(next(ends) - next(ends))
