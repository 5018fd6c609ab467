"""How sure the poses are: the covariance of all of them together, from the scatter of the planes' residuals.

Neighbouring residuals share the noise of the points and planes around them, and a point takes part in several pairs.
So the slopes of the cost are summed over small cells of the world, whatever pair they come from; cells are independent
(a sandwich, White 1980, clustered by cells): ``H^-1 (sum of u u^T) H^-1``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.graph import factorised, normal_matrix
from dqreg.multiway.joint import linearised
from dqreg.multiway.planes import Planes

# Nodes of whose covariances all are kept; beyond, each node's own alone.
ALL_KEPT = 100
# Variance of a scaled motion, in squares of a radian or of the size, beyond which it is free.
FREE = 1.0


def joint_covariance(T: FloatArray, planes: Sequence[Planes], free: IntArray, cell: float, size: float) -> FloatArray:
    """Covariance of the world increments of the free nodes about the world's origin, (6 k, 6 k).

    Rows and columns of free motions are NaN. Coordinates are relative to the middle of the graph, as ``T`` is given.
    """
    graph, _, blocks = linearised(T, planes)
    matrix = normal_matrix(graph, blocks)
    place = np.full(len(T), -1)
    place[free] = np.arange(len(free))
    slopes = _by_cell(T, planes, place, cell)
    scale = np.tile(np.r_[[1.0] * 3, [size] * 3], len(free))
    solve = factorised(matrix, free).solve
    half = solve(slopes.toarray()) if slopes.shape[1] < 3 * slopes.shape[0] else None
    if half is None:
        middle = (slopes @ slopes.T).toarray()
        covariance = solve(solve(middle).T).T
    else:
        covariance = half @ half.T
    # Cells are few beside the numbers estimated from them, a little.
    cells = slopes.shape[1]
    covariance = covariance * cells / max(cells - 6.0, 1.0)
    loose = np.diag(covariance) / scale**2 > FREE
    covariance[loose] = np.nan
    covariance[:, loose] = np.nan
    return 0.5 * (covariance + covariance.T)


def _by_cell(T: FloatArray, planes: Sequence[Planes], place: IntArray, cell: float) -> sparse.csc_matrix:
    """Slopes of the cost by the increments of the free nodes, one column a cell, (6 k, cells)."""
    rows, cells, values = [], [], []
    inner = np.arange(6)
    for each in planes:
        numbers, slopes = each.scores(T[each.target], cell)
        for node, sign in ((each.source, 1.0), (each.target, -1.0)):
            if place[node] >= 0:
                rows.append(np.broadcast_to(6 * place[node] + inner, slopes.shape).ravel())
                cells.append(np.repeat(numbers, 6))
                values.append(sign * slopes.ravel())
    size = 6 * int((place >= 0).sum())
    if not rows:
        return sparse.csc_matrix((size, 0))
    _, columns = np.unique(np.concatenate(cells), return_inverse=True)
    return sparse.csc_matrix((np.concatenate(values), (np.concatenate(rows), columns)), shape=(size, columns.max() + 1))
