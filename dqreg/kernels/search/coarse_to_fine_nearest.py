"""About the nearest point to each node of a regular grid, taken over from the nodes of a coarser grid around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# What stands between brackets counts from the end where it is below zero, which each access asks of a signed number.
U = np.uint64


@inside_kernels
def keep_nearer(
    places: FloatArray,
    held: NDArray[np.int32],
    squares: NDArray[np.float32],
    row: int,
    taker: int,
    x: int,
    y: int,
    z: int,
) -> None:
    """Hold a point at a node, (x, y, z), if it is nearer than what the node has."""
    node, k = U(taker), U(row)
    dx, dy, dz = places[k, 0] - x, places[k, 1] - y, places[k, 2] - z
    square = dx * dx + dy * dy + dz * dz
    if square < squares[node]:
        held[node], squares[node] = row, square


@compiled
def nearest_at_corners(
    places: FloatArray, shape: IntArray, held: NDArray[np.int32], squares: NDArray[np.float32]
) -> None:
    """Write the nearest of the points in the cells around each node, and the square of its distance. O(points).

    What is held is nearer than what was. Points are in cells from the first node, within the grid. Shapes: places
    (n, 3), held and squares (nodes,).
    """
    for row in range(len(places)):
        u, v, w = int(places[row, 0]), int(places[row, 1]), int(places[row, 2])
        for x in range(u, min(u + 2, shape[0])):
            for y in range(v, min(v + 2, shape[1])):
                for z in range(w, min(w + 2, shape[2])):
                    keep_nearer(places, held, squares, row, (x * shape[1] + y) * shape[2] + z, x, y, z)


@compiled
def nearest_from_coarser(
    first: int,
    last: int,
    places: FloatArray,
    shape: IntArray,
    coarse: IntArray,
    known: NDArray[np.int32],
    held: NDArray[np.int32],
    squares: NDArray[np.float32],
) -> None:
    """The same for slabs first to last of what the nodes around, of a grid of twice the cell, hold. O(nodes).

    Shapes: known (nodes of the coarser grid,).
    """
    for x in range(first, last):
        for y in range(shape[1]):
            for z in range(shape[2]):
                node = (x * shape[1] + y) * shape[2] + z
                # Every other node is one of the coarser grid along an axis, and has none but that around it there.
                for u in range(x // 2, (x + 1) // 2 + 1):
                    for v in range(y // 2, (y + 1) // 2 + 1):
                        for w in range(z // 2, (z + 1) // 2 + 1):
                            # Of the type that rows have above: whichever is compiled first decides for both, or not.
                            row = int(np.int64(known[U((u * coarse[1] + v) * coarse[2] + w)]))
                            if row != held[U(node)]:
                                keep_nearer(places, held, squares, row, node, x, y, z)


@compiled
def planes_at_nodes(
    first: int, last: int, held: NDArray[np.int32], places: FloatArray, normals: FloatArray, planes: NDArray[np.float32]
) -> None:
    """Write the places and normals, (n, 3), that nodes first to last hold, a node a row of (nodes, 6). O(1) a node."""
    for node in range(first, last):
        row = held[node]
        for k in range(3):
            planes[node, k], planes[node, 3 + k] = places[row, k], normals[row, k]
