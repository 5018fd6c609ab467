"""Sums over all pairs of patches of residuals, by the distance between the two."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled


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
    bins, count, xyz, uvw = len(products), len(points), points.T.copy(), normals.T.copy()
    x, y, z, u, v, w = xyz[0], xyz[1], xyz[2], uvw[0], uvw[1], uvw[2]
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
                products[k] += residuals[i] * residuals[j] * same
                squared[k] += same * same


@compiled
def spherical_covariance(points: FloatArray, sill: float, reach: float) -> tuple[IntArray, FloatArray]:
    """Pairs of points within reach, (p, 2), the later one first, and their covariances by the spherical model, (p,).

    They fall from the sill at no distance to zero from the reach on (Matheron 1963). Most pairs are out of range: a
    matrix of all would be megabytes that are written and read for them. O(m^2).
    """
    count, xyz = len(points), points.T.copy()
    x, y, z, apart = xyz[0], xyz[1], xyz[2], np.zeros(count)
    pairs, values, found = np.zeros((count, 2), np.int64), np.zeros(count), 0
    for i in range(count):
        a, b, c = x[i], y[i], z[i]
        for j in range(i):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            apart[j] = np.sqrt(dx * dx + dy * dy + dz * dz) / reach
        if found + i > len(pairs):
            more_pairs, more_values = np.zeros((2 * (found + i), 2), np.int64), np.zeros(2 * (found + i))
            more_pairs[:found], more_values[:found] = pairs[:found], values[:found]
            pairs, values = more_pairs, more_values
        for j in range(i):
            h = apart[j]
            if h < 1.0:
                pairs[found, 0], pairs[found, 1] = i, j
                values[found] = sill * (1.0 - h * (1.5 - 0.5 * h * h))
                found += 1
    return pairs[:found], values[:found]


@compiled
def covariance_products(
    pairs: IntArray, values: FloatArray, normals: FloatArray, columns: FloatArray, products: FloatArray
) -> float:
    """Write products of a covariance along the normals with columns, (m, k), and return its sum of squares. O(p k).

    The elements are those between pairs, (p, 2), times the cosine of both normals; all others are zero.
    """
    squares = 0.0
    for row in range(len(pairs)):
        i, j = pairs[row, 0], pairs[row, 1]
        same = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
        along = values[row] * same
        squares += 2.0 * along * along
        for k in range(columns.shape[1]):
            products[i, k] += along * columns[j, k]
            products[j, k] += along * columns[i, k]
    return squares
