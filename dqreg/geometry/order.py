"""Morton order: points close in space stand close in memory, so that neighbouring queries share cache lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg.arrays import BoolArray, FloatArray, IntArray

CodeArray = NDArray[np.uint64]

BITS = 21


def morton_order(points: FloatArray) -> IntArray:
    """Permutation that walks the points along a Z-order curve.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Finite points.

    Returns
    -------
    ndarray of int, (n,)
        ``points[morton_order(points)]`` is the ordered cloud; ties keep their order.

    Examples
    --------
    >>> morton_order(np.array([[9.0, 9, 9], [0, 0, 0], [0, 0, 1]])).tolist()
    [1, 2, 0]
    """
    return np.argsort(_codes(points), kind="stable")


def distinct_in_order(points: FloatArray) -> IntArray:
    """Rows in Morton order, each place once.

    Sensors write returns they did not get as copies of one point, often the origin; a thousand votes for one place
    would hold the pose there.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Finite points.

    Returns
    -------
    ndarray of int, (m,)
        Rows of ``points``; of exact copies the first is kept.

    Examples
    --------
    >>> distinct_in_order(np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0]])).tolist()
    [1, 0]
    """
    codes = _codes(points)
    order = np.argsort(codes, kind="stable")
    fresh, mixed = _news(points[order], codes[order])
    if mixed:
        # Different points share a cell and may stand between copies: rare, so only then all three numbers sort as well.
        order = np.lexsort((*points.T, codes))
        fresh, _ = _news(points[order], codes[order])
    return order[fresh]


def _news(walked: FloatArray, codes: CodeArray) -> tuple[BoolArray, bool]:
    # Which points differ from the one before, and whether two such share a cell.
    fresh = np.ones(len(walked), dtype=bool)
    fresh[1:] = (walked[1:] != walked[:-1]).any(axis=1)
    return fresh, bool((fresh[1:] & (codes[1:] == codes[:-1])).any())


def _codes(points: FloatArray) -> CodeArray:
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max())
    cells = 0.0 if extent == 0.0 else (2**BITS - 1) / extent
    grid = ((points - low) * cells).astype(np.uint64)
    return _spread(grid[:, 0]) << np.uint64(2) | _spread(grid[:, 1]) << np.uint64(1) | _spread(grid[:, 2])


def _spread(cell: CodeArray) -> CodeArray:
    # Two zero bits between each two bits of the cell number.
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        cell = (cell | (cell << np.uint64(shift))) & np.uint64(mask)
    return cell
