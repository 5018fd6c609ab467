"""Sums over all pairs of patches of residuals, by the distance between the two."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
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
def covariance_rows(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    sill: float,
    reach: float,
    covariances: FloatArray,
    along: FloatArray,
) -> None:
    """Write rows first to last of the covariances between points by the spherical model, each with no own.

    They fall from the sill at no distance to zero from the reach on (Matheron 1963). Along the normals they are times
    the cosine of both. Shapes: points and normals (m, 3), covariances and along (last - first, m). O(m) a row.
    """
    count, xyz, uvw = len(points), points.T.copy(), normals.T.copy()
    x, y, z, u, v, w = xyz[0], xyz[1], xyz[2], uvw[0], uvw[1], uvw[2]
    for i in range(first, last):
        a, b, c, p, q, r, one, other = x[i], y[i], z[i], u[i], v[i], w[i], covariances[i - first], along[i - first]
        for j in range(count):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            h = min(np.sqrt(dx * dx + dy * dy + dz * dz) / reach, 1.0)
            one[j] = sill * (1.0 - h * (1.5 - 0.5 * h * h))
            other[j] = one[j] * (p * u[j] + q * v[j] + r * w[j])
        one[i] = other[i] = 0.0
