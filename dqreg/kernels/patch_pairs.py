"""Sums over all pairs of patches of residuals, by the distance between the two."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled

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
    pulls: FloatArray,
    others: FloatArray,
    between: FloatArray,
    products: FloatArray,
) -> float:
    """Add what pairs nearer than reach say by their covariance, and return the squares of it along their normals.

    It falls from the sill at no distance to zero from the reach on, by the spherical model (Matheron 1963); no point
    has one with itself. To `between` go the pulls of one times those of the other along the same axis, of each pair in
    one order; to the products it times others, where it counts times the cosine of both normals. O(m^2), of pairs that
    are near O(k) each. Shapes: points and normals (m, 3), pulls (m, 3, k), others and products (m, 2, k), between (k,
    k); of k a multiple of 8 processors take several at a time.
    """
    count, xyz, uvw = len(points), points.T.copy(), normals.T.copy()
    x, y, z, u, v, w = xyz[0], xyz[1], xyz[2], uvw[0], uvw[1], uvw[2]
    squares, cosines, limit, total = np.zeros(count), np.zeros(count), reach * reach, 0.0
    many = len(between)
    along, beside, beyond = (
        pulls.reshape(count, 3 * many),
        others.reshape(count, 2 * many),
        products.reshape(count, 2 * many),
    )
    pulled, held = np.zeros(3 * many), np.zeros(2 * many)
    for i in range(count):
        a, b, c, p, q, r = x[i], y[i], z[i], u[i], v[i], w[i]
        for j in range(i):
            dx, dy, dz = a - x[j], b - y[j], c - z[j]
            squares[j] = dx * dx + dy * dy + dz * dz
            cosines[j] = p * u[j] + q * v[j] + r * w[j]
        pulled[:], held[:], some = 0.0, 0.0, False
        for start in range(0, i, BLOCK):
            end, near = min(start + BLOCK, i), 0
            # Whether any is near at all processors tell of several at a time; most blocks hold none.
            for j in range(start, end):
                near += 1 if squares[j] < limit else 0
            some = some or near > 0
            for j in range(start, end if near else start):
                if squares[j] >= limit:
                    continue
                h = np.sqrt(squares[j]) / reach
                shared = sill * (1.0 - h * (1.5 - 0.5 * h * h))
                same = shared * cosines[j]
                total += same * same
                for m in range(3 * many):
                    pulled[m] += shared * along[j, m]
                for m in range(2 * many):
                    held[m] += same * beside[j, m]
                    beyond[j, m] += same * beside[i, m]
        for m in range(2 * many if some else 0):
            beyond[i, m] += held[m]
        for start in range(0, 3 * many if some else 0, many):
            for k in range(many):
                for m in range(many):
                    between[k, m] += along[i, start + k] * pulled[start + m]
    return 2.0 * total
