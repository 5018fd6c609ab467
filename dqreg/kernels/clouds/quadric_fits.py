"""Quadrics through neighbouring points, over their planes: what is left is noise, and no curvature."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Coefficients of a height over two coordinates, up to squares.
COEFFICIENTS = 6
# On two lines the square across them is not determined: this share of the squares leaves it at zero.
RIDGE = 1e-9


@compiled
def quadric_residual_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    normals: FloatArray,
    least: float,
    residuals: FloatArray,
) -> None:
    """Write what the k neighbours of rows first to last, (m, k), leave of a quadric over their plane, (m,). O(k) a row.

    Root mean square, with k - 6 degrees of freedom; NaN where the least spread along the plane is below a share of the
    largest. Shapes: normals (m, 3).
    """
    count = neighbours.shape[1]
    local, terms = np.zeros((count, 3)), np.zeros(COEFFICIENTS)
    squares, found = np.zeros((COEFFICIENTS, COEFFICIENTS)), np.zeros(COEFFICIENTS)
    limit = 1.0 - ((1.0 - least**2) / (1.0 + least**2)) ** 2
    for i in range(first, last):
        total, product = place(points, neighbours, i, normals, local)
        residuals[i] = np.nan
        # The least variance of the two over the largest, from sum and product.
        if not 4.0 * product > total * total * limit:
            continue
        size = math.sqrt(total)
        for a in range(COEFFICIENTS):
            found[a] = 0.0
            for b in range(COEFFICIENTS):
                squares[a, b] = RIDGE if a == b else 0.0
        for j in range(count):
            write_terms(local, j, size, terms)
            for a in range(COEFFICIENTS):
                found[a] += terms[a] * local[j, 2]
                for b in range(a + 1):
                    squares[a, b] += terms[a] * terms[b]
        solve(squares, found)
        left = 0.0
        for j in range(count):
            write_terms(local, j, size, terms)
            height = local[j, 2]
            for a in range(COEFFICIENTS):
                height -= terms[a] * found[a]
            left += height * height
        residuals[i] = math.sqrt(left / (count - COEFFICIENTS))


@inside_kernels
def place(
    points: FloatArray, neighbours: IntArray, i: int, normals: FloatArray, local: FloatArray
) -> tuple[float, float]:
    """Write neighbours in a frame of their middle and a normal, (k, 3); sum and product of the variances across it."""
    count, x, y, z = neighbours.shape[1], 0.0, 0.0, 0.0
    for j in range(count):
        t = neighbours[i, j]
        x, y, z = x + points[t, 0], y + points[t, 1], z + points[t, 2]
    x, y, z = x / count, y / count, z / count
    n, p, q = normals[i, 0], normals[i, 1], normals[i, 2]
    # Any direction across the normal: its least axis, made perpendicular.
    axis = 0 if abs(n) <= abs(p) and abs(n) <= abs(q) else (1 if abs(p) <= abs(q) else 2)
    along = n if axis == 0 else (p if axis == 1 else q)
    a = (1.0 if axis == 0 else 0.0) - along * n
    b = (1.0 if axis == 1 else 0.0) - along * p
    c = (1.0 if axis == 2 else 0.0) - along * q
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    d, e, f = p * c - q * b, q * a - n * c, n * b - p * a
    uu, vv, uv = 0.0, 0.0, 0.0
    for j in range(count):
        t = neighbours[i, j]
        dx, dy, dz = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
        u, v = a * dx + b * dy + c * dz, d * dx + e * dy + f * dz
        local[j, 0], local[j, 1], local[j, 2] = u, v, n * dx + p * dy + q * dz
        uu, vv, uv = uu + u * u, vv + v * v, uv + u * v
    uu, vv, uv = uu / count, vv / count, uv / count
    return uu + vv, uu * vv - uv * uv


@inside_kernels
def write_terms(local: FloatArray, j: int, size: float, terms: FloatArray) -> None:
    """Write what each coefficient of a quadric counts for at a point."""
    u, v = local[j, 0] / size, local[j, 1] / size
    terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = 1.0, u, v, u * u, u * v, v * v


@compiled
def solve(squares: FloatArray, found: FloatArray) -> None:
    """Solve a positive definite system, given by its lower half, in place: Cholesky's factors."""
    n = len(found)
    for a in range(n):
        for b in range(a + 1):
            value = squares[a, b]
            for k in range(b):
                value -= squares[a, k] * squares[b, k]
            squares[a, b] = math.sqrt(max(value, RIDGE * RIDGE)) if a == b else value / squares[b, b]
    for a in range(n):
        for k in range(a):
            found[a] -= squares[a, k] * found[k]
        found[a] /= squares[a, a]
    for a in range(n - 1, -1, -1):
        for k in range(a + 1, n):
            found[a] -= squares[k, a] * found[k]
        found[a] /= squares[a, a]
