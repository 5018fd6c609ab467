"""Morton order: points close in space stand close in memory, so that neighbouring queries share cache lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray

CodeArray = NDArray[np.uint64]

BITS = 21
# Points coded at once: what is in between stays in the cache, which halves the time.
CHUNK = 65_536


def morton_order(points: FloatArray) -> IntArray:
    """Permutation that walks the points along a Z-order curve."""
    return np.argsort(morton_codes(points), kind="stable")


def distinct_in_order(points: FloatArray) -> IntArray:
    """Rows in Morton order, each place once.

    Sensors write missing returns as copies of one point, often the origin: a thousand duplicates would bias the pose.

    Shapes: returns (m,).
    """
    codes = morton_codes(points)
    order = np.argsort(codes, kind="stable")
    new, mixed = _is_new(points, codes, order)
    if mixed:
        # Different points share a cell and may stand between copies: rare, so only then coordinates are sorted too.
        order = np.lexsort((*points.T, codes))
        new, _ = _is_new(points, codes, order)
    return order[new]


def _is_new(points: FloatArray, codes: CodeArray, order: IntArray) -> tuple[BoolArray, bool]:
    # Which points differ from the one before, and whether two such share a cell. Only points of one cell can be copies.
    walked = codes[order]
    shared = np.flatnonzero(walked[1:] == walked[:-1]) + 1
    differ = (points[order[shared]] != points[order[shared - 1]]).any(axis=1)
    new = np.ones(len(order), dtype=bool)
    new[shared] = differ
    return new, bool(differ.any())


def morton_codes(points: FloatArray, size: float = 0.0) -> CodeArray:
    """Place of each point along the Z-order curve: the number of its cell.

    >>> morton_codes(np.array([[0.0, 0, 0], [0.4, 0, 0], [0, 0, 1.2]]), 1.0).tolist()
    [0, 0, 1]
    """
    # Column by column: rows of three cost NumPy ten times as much.
    columns = np.ascontiguousarray(points.T)
    lows = columns.min(axis=1)
    extent = float((columns.max(axis=1) - lows).max())
    cells = 0.0 if extent == 0.0 else (2**BITS - 1) / extent
    cells = min(cells, 1.0 / size) if size > 0.0 else cells
    codes = np.zeros(len(points), dtype=np.uint64)
    for i in range(0, len(points), CHUNK):
        part = codes[i : i + CHUNK]
        for axis, column in enumerate(columns):
            grid = ((column[i : i + CHUNK] - lows[axis]) * cells).astype(np.int64)
            spread = SPREAD.take(grid >> HALF)
            spread <<= np.uint64(3 * HALF)
            spread |= SPREAD.take(grid & (2**HALF - 1))
            spread <<= np.uint64(2 - axis)
            part |= spread
    return codes


def _spread(cells: IntArray) -> CodeArray:
    # Two zero bits between each two bits of the cell number.
    spread = np.zeros(len(cells), dtype=np.uint64)
    for bit in range(BITS):
        spread |= (cells.astype(np.uint64) >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit)
    return spread


# Half of the bits are looked up at once.
HALF = (BITS + 1) // 2
SPREAD = _spread(np.arange(2**HALF))
