"""Sums over all pairs of patches of residuals, by the distance between the two."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled

# Pairs of one point that are looked at together.
BLOCK = 64


@compiled
def nearest_others(points: FloatArray, nearest: FloatArray) -> float:
    """Write the distance of each of some points to the nearest other one, (m,); the largest of all. O(m^2)."""
    count, xyz = len(points), points.T.copy()
    x, y, z = xyz[0], xyz[1], xyz[2]
    farthest = np.zeros(count)
    for j in range(count):
        nearest[j] = np.inf
    # Column by column, each number by itself: so processors take several at a time.
    for i in range(count):
        a, b, c, own = x[i], y[i], z[i], nearest[i]
        for j in range(count):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            square = dx * dx + dy * dy + dz * dz
            nearest[j] = min(nearest[j], square)
            farthest[j] = max(farthest[j], square)
        # It is not its own neighbour.
        nearest[i] = own
    most = 0.0
    for j in range(count):
        nearest[j] = np.sqrt(nearest[j])
        most = max(most, farthest[j])
    return float(np.sqrt(most))


@compiled
def binned_agreements(
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    far: float,
    products: FloatArray,
    squared: FloatArray,
) -> None:
    """Add, for each pair nearer than far, to the bin of its distance; what is farther apart is left out. O(m^2).

    What is added are the product of both residuals times the cosine of their normals, and the square of the cosine.
    Shapes: points and normals (m, 3), residuals (m,); products and squared (bins,), of equal widths from 0 to far.
    """
    bins, count, held = len(products), 0, np.zeros((7, len(points)))
    for i in range(len(points)):
        # Without a normal nothing is added.
        if normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0:
            for k in range(3):
                held[k, count], held[3 + k, count] = points[i, k], normals[i, k]
            held[6, count] = residuals[i]
            count += 1
    x, y, z, u, v, w, off = held[0], held[1], held[2], held[3], held[4], held[5], held[6]
    places, cosines = np.zeros(count), np.zeros(count)
    for i in range(count):
        a, b, c, p, q, r, scale = x[i], y[i], z[i], u[i], v[i], w[i], bins / far
        # What needs no bin first: processors take several of these at a time.
        for j in range(i):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            places[j] = np.sqrt(dx * dx + dy * dy + dz * dz) * scale
            cosines[j] = p * u[j] + q * v[j] + r * w[j]
        for j in range(i):
            if places[j] < bins:
                k, same = int(places[j]), cosines[j]
                products[k] += off[i] * off[j] * same
                squared[k] += same * same


@compiled
def best_range(
    ranges: FloatArray, products: FloatArray, squared: FloatArray, far: float, variance: float
) -> tuple[float, float, float]:
    """Sill, range and excess of the spherical model that explains binned agreements best, among some ranges up to far.

    Its excess is in standard errors of independent noise of a variance; zeros where none agree more than by chance.
    O(ranges bins). Shapes: products and squared (bins,), from `binned_agreements`.
    """
    width, sill, best, most = far / len(products), 0.0, 0.0, 0.0
    for row in range(len(ranges)):
        reach, agreement, norm = ranges[row], 0.0, 0.0
        if not 0.0 < reach <= far:
            continue
        for k in range(len(products)):
            h = (k + 0.5) * width / reach
            if h >= 1.0:
                break
            model = 1.0 - h * (1.5 - 0.5 * h * h)
            agreement += model * products[k]
            norm += model * model * squared[k]
        error = variance * np.sqrt(norm)
        if error > 0.0 and agreement > most * error:
            sill, best, most = agreement / norm, reach, agreement / error
    return sill, best, most


@compiled
def covariance_sums(
    points: FloatArray,
    normals: FloatArray,
    sill: float,
    reach: float,
    columns: FloatArray,
    others: FloatArray,
    earlier: FloatArray,
    all_others: FloatArray,
) -> float:
    """Add what points nearer than reach have in common by their covariance; the sum of its squares along the normals.

    It falls from the sill at no distance to zero from the reach on, by the spherical model (Matheron 1963); no point
    has one with itself. Along the normals it is times the cosine of both. Added are the columns of all points before
    each, times the covariance, and the others of all points, times that along the normals. O(m^2), and O(k) for each
    pair that is near. Shapes: points and normals (m, 3), columns and earlier (m, k), others and all_others (m, n); of
    multiples of 8 processors take several at a time.
    """
    count, xyz, uvw = len(points), points.T.copy(), normals.T.copy()
    x, y, z, u, v, w = xyz[0], xyz[1], xyz[2], uvw[0], uvw[1], uvw[2]
    squares, cosines, limit, total = np.zeros(count), np.zeros(count), reach * reach, 0.0
    drawn, held = np.zeros(columns.shape[1]), np.zeros(others.shape[1])
    for i in range(count):
        a, b, c, p, q, r = x[i], y[i], z[i], u[i], v[i], w[i]
        drawn[:], held[:] = 0.0, 0.0
        for j in range(i):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            squares[j] = dx * dx + dy * dy + dz * dz
        for start in range(0, i, BLOCK):
            end, near = min(start + BLOCK, i), 0
            # Whether any is near at all processors tell of several at a time; most blocks hold none.
            for j in range(start, end):
                near += 1 if squares[j] < limit else 0
            if near == 0:
                continue
            for j in range(start, end):
                cosines[j] = p * u[j] + q * v[j] + r * w[j]
            for j in range(start, end):
                if squares[j] >= limit:
                    continue
                h = np.sqrt(squares[j]) / reach
                shared = sill * (1.0 - h * (1.5 - 0.5 * h * h))
                along = shared * cosines[j]
                total += along * along
                for m in range(columns.shape[1]):
                    drawn[m] += shared * columns[j, m]
                for m in range(others.shape[1]):
                    held[m] += along * others[j, m]
                    all_others[j, m] += along * others[i, m]
        for m in range(columns.shape[1]):
            earlier[i, m] += drawn[m]
        for m in range(others.shape[1]):
            all_others[i, m] += held[m]
    return 2.0 * total
