"""Which placed scans overlap, from the cells of a grid that their points fill."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.scans.scans import View, every_so_many
from dqreg.rigid import pose

# Edge of a cell in typical sizes of a scan, and points that fill the cells of one.
CELL_SIZES, COMPARED_POINTS = 0.03, 4_000
# Bits of a cell's number along one axis.
AXIS_BITS = 21
# Pairs that share fewer cells than this, of the smaller scan, have nothing in common but their borders.
MIN_OVERLAP = 0.08


def overlap_matrix(
    views: Sequence[View], T_world_scan: FloatArray, size: float, cell: float = CELL_SIZES
) -> FloatArray:
    """Fraction of the cells of the smaller scan that the other fills too, (n, n); NaN where one is not placed."""
    edge = cell * size
    placed = [k for k, view in enumerate(views) if view.usable and np.isfinite(T_world_scan[k]).all()]
    filled = [cells_of(pose.apply(T_world_scan[k], _some(views[k])), edge) for k in placed]
    overlap = np.full((len(views), len(views)), np.nan)
    if not placed:
        return overlap
    _, columns = np.unique(np.concatenate(filled), return_inverse=True)
    rows = np.repeat(np.arange(len(placed)), [len(cells) for cells in filled])
    member = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)))
    shared = (member @ member.T).toarray()
    counts = shared.diagonal()
    overlap[np.ix_(placed, placed)] = shared / np.minimum(counts[:, None], counts)
    return overlap


def cells_of(points: FloatArray, edge: float) -> IntArray:
    """Numbers of the cells that points fill, each once."""
    return np.unique(cell_numbers(points, edge))


def cell_numbers(points: FloatArray, edge: float) -> IntArray:
    """Number of the cell of each point, (n,); cells count from a fixed corner, so that scans share them."""
    grid = np.floor(points / edge).astype(np.int64) + (1 << (AXIS_BITS - 1))
    return np.asarray((grid[:, 0] << (2 * AXIS_BITS)) | (grid[:, 1] << AXIS_BITS) | grid[:, 2])


def _some(view: View) -> FloatArray:
    assert view.cloud is not None
    return every_so_many(view.cloud.points, COMPARED_POINTS)
