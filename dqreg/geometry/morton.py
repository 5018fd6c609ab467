"""Morton order: points close in space stand close in memory, so that neighbouring queries share cache lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry.moved_points import UNMOVED, moved

CodeArray = NDArray[np.uint64]
# Lowest and highest coordinates of points.
Ends = tuple[FloatArray, FloatArray]

# Points coded in one go: some milliseconds.
CHUNK_POINTS = 65_536
# Points from which on a kernel that goes over all of them runs aside, so that an interrupt is seen at once.
ASIDE_POINTS = 500_000
# Codes from which on their order is made on all threads.
SPLIT_SORT_CODES = 2 * CHUNK_POINTS


def morton_order(points: FloatArray) -> IntArray:
    """Permutation that walks the points along a Z-order curve."""
    return sorted_rows(morton_codes(points))


def distinct_in_order(points: FloatArray, ends: Ends | None = None, move: FloatArray = UNMOVED) -> IntArray:
    """Rows in Morton order, each place once; the ends are what `bounds` gives, after the move where there is one.

    Sensors write missing returns as copies of one point, often the origin: a thousand duplicates would bias the pose.

    Shapes: returns (m,).
    """
    from dqreg.kernels.order.morton import new_places
    from dqreg.kernels.threads import as_plain

    points, ends = as_plain(points), bounds(points) if ends is None else ends
    order, keys = sorted_codes(codes_on_grid(points, *corner_and_cells(points, ends=ends), move))
    new, mixed = new_places(points, move, keys, order)
    if mixed:
        # Different points share a cell and may stand between copies: there, coordinates are sorted too.
        shared = np.zeros(len(order), dtype=bool)
        shared[1:] = keys[1:] == keys[:-1]
        shared[:-1] |= shared[1:]
        rows = order[shared]
        order[shared] = rows[np.lexsort((*moved(points[rows], move).T, keys[shared]))]
        new, _ = new_places(points, move, keys, order)
    # Without copies nothing is left out.
    return order if new.all() else order[new]


def in_order(points: FloatArray, order: IntArray, move: FloatArray = UNMOVED) -> FloatArray:
    """Points in an order of their rows, (m, 3), on all threads, after a move: most come from far away in memory."""
    from dqreg.kernels.order.morton import take_points
    from dqreg.kernels.threads import as_plain, over_chunks

    taken = np.zeros((len(order), 3))
    over_chunks(take_points, len(order), as_plain(points), move, order, taken, chunk=CHUNK_POINTS)
    return taken


def sorted_rows(codes: CodeArray) -> IntArray:
    """Stable order of codes."""
    return sorted_codes(codes)[0]


def sorted_codes(codes: CodeArray) -> tuple[IntArray, CodeArray]:
    """Stable order of codes, and the codes in it."""
    if len(codes) > SPLIT_SORT_CODES:
        from dqreg.kernels.order.split_sort import split_sorted_rows

        return split_sorted_rows(codes)
    from dqreg.kernels.order import morton

    return morton.sorted_rows(codes)


def morton_codes(points: FloatArray, size: float = 0.0, ends: Ends | None = None) -> CodeArray:
    """Place of each point along the Z-order curve: the number of its cell; the ends as in `distinct_in_order`.

    >>> morton_codes(np.array([[0.0, 0, 0], [0.4, 0, 0], [0, 0, 1.2]]), 1.0).tolist()
    [0, 0, 1]
    """
    return codes_on_grid(points, *corner_and_cells(points, size, ends))


def cells_by_edge(points: FloatArray, move: FloatArray, ends: Ends, finest: int) -> IntArray:
    """How many cells hold points at each edge, so many times the least one doubled to begin with, and on from there.

    The ends are those of the points after their move, see `moved`.
    """
    from dqreg.kernels.order import morton
    from dqreg.kernels.threads import as_plain

    low, per_length = corner_and_cells(points, ends=ends)
    if len(points) <= SPLIT_SORT_CODES:
        return morton.filled_cells(as_plain(points), move, as_plain(low), per_length, 3 * finest)
    codes = codes_on_grid(points, low, per_length, move)
    return morton.count_cells(sorted_codes(codes >> np.uint64(3 * finest))[1])


def codes_on_grid(points: FloatArray, low: FloatArray, per_length: float, move: FloatArray = UNMOVED) -> CodeArray:
    """The same in cells from a corner on, (3,), of which there are so many a length, after a move, (4,)."""
    from dqreg.kernels.order.morton import morton_cells
    from dqreg.kernels.threads import as_plain, over_chunks

    codes = np.zeros(len(points), dtype=np.uint64)
    over_chunks(morton_cells, len(points), as_plain(points), move, as_plain(low), per_length, codes, chunk=CHUNK_POINTS)
    return codes


def corner_and_cells(points: FloatArray, size: float = 0.0, ends: Ends | None = None) -> tuple[FloatArray, float]:
    """Corner from which cells of an edge begin, (3,), and how many of them there are a length; see `edge_of_cells`."""
    from dqreg.kernels.order.morton import BITS

    low, high = bounds(points) if ends is None else ends
    extent = float((high - low).max())
    cells = 0.0 if extent == 0.0 else (2**BITS - 1) / extent
    return low, float(min(cells, 1.0 / size) if size > 0.0 else cells)


def edge_of_cells(points: FloatArray, size: float = 0.0, ends: Ends | None = None) -> float:
    """Edge of the cells of `morton_codes`: it is the least that codes have numbers for, where a smaller one is asked.

    >>> edge_of_cells(np.array([[0.0, 0, 0], [0.4, 0, 1.2]]), 1.0)
    1.0
    """
    from dqreg.kernels.order.morton import BITS

    low, high = bounds(points) if ends is None else ends
    return max(size, float((high - low).max() / (2**BITS - 1)))
