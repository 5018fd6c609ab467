"""Scatter of points about the faces that they are matched to: of each orientation, face and part of a scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

NOTHING = np.zeros(0)


@compiled
def square_heights(
    first: int,
    last: int,
    moved: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    scatter: FloatArray,
    squares: FloatArray,
) -> None:
    """Write squares of the heights of points with a weight over the planes at their feet, (n,). O(n).

    Scatter is added to them, (n,), or none at all. Shapes: moved, feet, normals (n, 3).
    """
    for i in range(first, last):
        if weights[i] > 0.0:
            height = 0.0
            for k in range(3):
                height += (moved[i, k] - feet[i, k]) * normals[i, k]
            squares[i] = height * height + (scatter[i] if len(scatter) else 0.0)


@compiled
def face_sums(
    squares: FloatArray,
    weights: FloatArray,
    faces: IntArray,
    parts: NDArray[np.uint8],
    sums: FloatArray,
    rows: IntArray,
) -> None:
    """Add weighted squares and weights of each part of a scan on each face, (m, p, 2); a row of each face, (m,). O(n).

    Parts (n,), or (0,) for one part.
    """
    for i in range(len(weights)):
        w = weights[i]
        if w > 0.0:
            face, part = faces[i], np.int64(parts[i]) if len(parts) else np.int64(0)
            sums[face, part, 0] += w * squares[i]
            sums[face, part, 1] += w
            rows[face] = i


@compiled
def face_precisions(
    sums: FloatArray,
    rows: IntArray,
    normals: FloatArray,
    cells: int,
    of_cells: FloatArray,
    beforehand: float,
    before_faces: float,
    least: float,
    precisions: FloatArray,
) -> None:
    """Write one over the variance of each part on each face, (m, p); their weighted mean is one. O(m p).

    Each cell of normals has a weight of the usual variance beforehand, each face one of its cell's, and each part one
    of its face's. ``least`` is the least variance, in usual ones. Shapes: normals (n, 3), sums of the cells (c, 2).
    """
    total, weight, mean = 0.0, 0.0, 0.0
    for face in range(len(sums)):
        square, held = _of_face(sums, face)
        if held > 0.0:
            cell = cell_of(normals, rows[face], cells)
            of_cells[cell, 0] += square
            of_cells[cell, 1] += held
            total, weight = total + square, weight + held
    usual = total / weight if weight > 0.0 else 0.0
    if not usual > 0.0:
        return
    for face in range(len(sums)):
        square, held = _of_face(sums, face)
        if held > 0.0:
            cell = cell_of(normals, rows[face], cells)
            variance = (of_cells[cell, 0] + beforehand * usual) / (of_cells[cell, 1] + beforehand)
            variance = (square + before_faces * variance) / (held + before_faces)
            for part in range(sums.shape[1]):
                own = (sums[face, part, 0] + before_faces * variance) / (sums[face, part, 1] + before_faces)
                precisions[face, part] = 1.0 / max(own, least * usual)
                mean += sums[face, part, 1] * precisions[face, part] / weight
    for face in range(len(sums)):
        for part in range(sums.shape[1]):
            precisions[face, part] /= mean


@inside_kernels
def _of_face(sums: FloatArray, face: int) -> tuple[float, float]:
    square, held = 0.0, 0.0
    for part in range(sums.shape[1]):
        square, held = square + sums[face, part, 0], held + sums[face, part, 1]
    return square, held


@inside_kernels
def cell_of(normals: FloatArray, i: int, cells: int) -> np.int64:
    """Cell of a unit normal in the cube around it, so many along each axis and one more."""
    cell = np.int64(0)
    for k in range(3):
        place = (normals[i, k] + 1.0) * (0.5 * cells) + 0.5
        # Rounding may leave the cube, and what is no number has no cell of its own.
        cell = cell * (cells + 1) + (np.int64(place) if 0.0 < place < cells + 1.0 else np.int64(0))
    return cell


@compiled
def orientation_cells(first: int, last: int, normals: FloatArray, cells: int, found: IntArray) -> None:
    """Write the cell of each normal, (n,). O(n)."""
    for i in range(first, last):
        found[i] = cell_of(normals, i, cells)


@compiled
def times_precisions(
    first: int, last: int, faces: IntArray, parts: NDArray[np.uint8], precisions: FloatArray, weights: FloatArray
) -> None:
    """Multiply weights, (n,), with the precision of the part on their face, (m, p). O(n)."""
    for i in range(first, last):
        if weights[i] > 0.0:
            weights[i] *= precisions[faces[i], np.int64(parts[i]) if len(parts) else 0]
