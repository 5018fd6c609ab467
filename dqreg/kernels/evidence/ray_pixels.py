"""Pixels of the sphere about a scanner, in rows of equal height, and what the rays in them met."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Counts of a pose: points that rays passed through, that were seen as far, and that are behind something.
COUNTS = 3


@compiled
def fill_pixels(
    arms: FloatArray,
    pixel: float,
    firsts: IntArray,
    columns: IntArray,
    nearest: FloatArray,
    farthest: FloatArray,
    at: IntArray,
) -> None:
    """Write the least and the largest range in each pixel, (p,), and in which of them each point is, (n,).

    Shapes: arms (n, 3) from the scanner, the pole last; first pixel and number of columns of each row, (r,).
    """
    for i in range(len(arms)):
        x, y, z = arms[i, 0], arms[i, 1], arms[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        row = _row_of(z / length, pixel, len(columns))
        k = firsts[row] + _column_of(x, y, columns[row])
        at[i] = k
        nearest[k], farthest[k] = min(nearest[k], length), max(farthest[k], length)


@compiled
def rays_met(
    first: int,
    last: int,
    points: FloatArray,
    turns: FloatArray,
    shifts: FloatArray,
    pixel: float,
    firsts: IntArray,
    columns: IntArray,
    nearest: FloatArray,
    farthest: FloatArray,
    margin: float,
    blur: float,
    pole: float,
    counts: IntArray,
) -> None:
    """Count, for the poses first to last, what the rays around each point met: see `COUNTS`.

    A point counts where all pixels about its own hold a ray: it is in view, and away from the poles. All of them met
    something farther, by a margin and a share of the range: they passed through it. All met something nearer: it is
    behind. Shapes: points (n, 3), turns (k, 3, 3) and shifts (k, 3) to the frame of the pixels, counts (k, 3).
    """
    for k in range(first, last):
        for i in range(len(points)):
            a, b, c = points[i, 0], points[i, 1], points[i, 2]
            x = turns[k, 0, 0] * a + turns[k, 0, 1] * b + turns[k, 0, 2] * c + shifts[k, 0]
            y = turns[k, 1, 0] * a + turns[k, 1, 1] * b + turns[k, 1, 2] * c + shifts[k, 1]
            z = turns[k, 2, 0] * a + turns[k, 2, 1] * b + turns[k, 2, 2] * c + shifts[k, 2]
            length = np.sqrt(x * x + y * y + z * z)
            if not abs(z) < pole * length:
                continue
            low, high = _around(x, y, z / length, pixel, firsts, columns, nearest, farthest)
            step = margin + blur * length
            if low == np.inf:
                continue
            if low - length > step:
                counts[k, 0] += 1
            elif length - high > step:
                counts[k, 2] += 1
            else:
                counts[k, 1] += 1


@inside_kernels
def _around(
    x: float,
    y: float,
    sine: float,
    pixel: float,
    firsts: IntArray,
    columns: IntArray,
    nearest: FloatArray,
    farthest: FloatArray,
) -> tuple[float, float]:
    """The least and the largest range in a pixel and the eight about it; infinite where one of them is empty."""
    row, low, high = _row_of(sine, pixel, len(columns)), np.inf, 0.0
    for other in range(row - 1, row + 2):
        if other < 0 or other >= len(columns):
            return np.inf, 0.0
        column = _column_of(x, y, columns[other])
        for step in range(-1, 2):
            k = firsts[other] + (column + step) % columns[other]
            if nearest[k] == np.inf:
                return np.inf, 0.0
            low, high = min(low, nearest[k]), max(high, farthest[k])
    return low, high


@inside_kernels
def _row_of(sine: float, pixel: float, rows: int) -> int:
    return min(int((np.arcsin(min(max(sine, -1.0), 1.0)) + 0.5 * np.pi) / pixel), rows - 1)


@inside_kernels
def _column_of(x: float, y: float, columns: int) -> int:
    return min(int((np.arctan2(y, x) + np.pi) / (2.0 * np.pi) * columns), columns - 1)
