"""Steps of a pose onto planes held fixed, each with the kernel that its distances ask for: EM and Gauss-Newton."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.steps.free_shifts import hold_free_shifts
from dqreg.kernels.steps.row_products import COLUMNS, LANES, PRODUCTS, RIGHT, UNKNOWNS, WEIGHT, add_rows, place_sums

# Damping of unknowns that nothing holds, over the mean of their kind.
DAMPING = 1e-3
# Places of the limits, and of the figures of the last step: what is learned from each.
SCALE, FRACTION = 0, 1
# Of the limits of both kernels: largest distance; least fraction of inliers and of those that are none; least scale and
# largest fall of it in a step; root mean square range of the points; motion below which the step is the last; and
# information, in variances of the normals, below which a translation is left as it is.
FARTHEST, LEAST_FRACTION = 2, 3
FLOOR, STEEPEST = 4, 5
LEVER, ENOUGH = 6, 7
LEAST_INFORMATION = 8
# Of the limits of this one: least cosine of the normals; whether a point without a plane says nothing: it counts as the
# others do on average.
COSINE, SILENT = 9, 10
# Of the figures: the energy; sums of the weights and of the weighed squares; rows with a weight; and the motion.
ENERGY, TOTAL = 2, 3
SQUARES, USED = 4, 5
MOTION, FIGURES = 6, 7
# Products of densities are added up once they are below this.
TINY = 1e-200


@compiled
def step_on_planes(
    points: FloatArray,
    own: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    variances: FloatArray,
    roughness: FloatArray,
    limits: FloatArray,
    steps: int,
    T: FloatArray,
    weights: FloatArray,
    figures: FloatArray,
) -> None:
    """Move a pose, (4, 4), onto planes, step by step, and learn the mixture of the distances in each. O(steps n).

    Points slide along the planes through their feet, as far aside of these as they were found; without a plane a point
    says how well it fits, and moves nothing. Weights and figures are those before the last step, but for the mixture.
    """
    count = len(points)
    farthest, cosine, scale, fraction = limits[FARTHEST], limits[COSINE], limits[SCALE], limits[FRACTION]
    silent = limits[SILENT] > 0.0
    aside, A, g = np.zeros(count), np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
    # Of the type of other numbers: for a plain one what it is given to would be compiled once more.
    none = int(np.int64(0))
    rows, sums = np.zeros((COLUMNS, LANES)), np.zeros((1, PRODUCTS, LANES))
    for i in range(count):
        aside[i] = _aside(i, points, own, feet, normals, distances[i], farthest, cosine, T)
    for _ in range(steps):
        odds = (1.0 - fraction) / farthest * scale * math.sqrt(0.5 * math.pi) / fraction
        beyond = math.log(math.exp(-0.5 * (farthest / scale) ** 2) + odds)
        sums[:], waiting = 0.0, 0
        total, squares, used, energy, near, many, noise = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0
        for i in range(count):
            weights[i] = 0.0
            if aside[i] < 0.0:
                energy += beyond
                continue
            x, y, z = _turned(T, points, i)
            rx, ry, rz = x + T[0, 3] - feet[i, 0], y + T[1, 3] - feet[i, 1], z + T[2, 3] - feet[i, 2]
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            known = nx != 0.0 or ny != 0.0 or nz != 0.0
            if silent and not known:
                weights[i] = fraction
                continue
            h = rx * nx + ry * ny + rz * nz
            square = h * h + aside[i] if known else rx * rx + ry * ry + rz * rz
            if square > farthest * farthest:
                energy += beyond
                continue
            near += 1.0
            density = math.exp(-0.5 * square / (scale * scale))
            w = density / (density + odds)
            # One logarithm for many.
            many *= density + odds
            if many < TINY:
                energy, many = energy + math.log(many), 1.0
            weights[i] = w
            total, squares, used = total + w, squares + w * square, used + (1.0 if w > 0.0 else 0.0)
            if not known:
                continue
            w *= by_roughness(scale, roughness[i])
            noise += w * min(variances[i], 1.0)
            rows[0, waiting], rows[1, waiting], rows[2, waiting] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
            rows[3, waiting], rows[4, waiting], rows[5, waiting] = nx, ny, nz
            rows[RIGHT, waiting], rows[WEIGHT, waiting] = h, w
            waiting += 1
            if waiting == LANES:
                add_rows(rows, sums)
                waiting = 0
        rows[WEIGHT, waiting:] = 0.0
        add_rows(rows, sums)
        place_sums(sums[0], A, g, none, none)
        energy += math.log(many)
        put_figures(figures, scale, fraction, total, squares, used)
        figures[ENERGY] = -2.0 * scale * scale * (energy / count - math.log1p(odds))
        if used < UNKNOWNS or not total > 0.0:
            return
        figures[MOTION] = _move(A, g, limits[LEVER], limits[LEAST_INFORMATION] * noise, T)
        learn(figures, limits, near)
        if figures[MOTION] <= limits[ENOUGH]:
            return
        scale, fraction = figures[SCALE], figures[FRACTION]


@compiled
def weigh_by_roughness(weights: FloatArray, roughness: FloatArray, scale: float) -> None:
    """Multiply weights as the steps do, (n,), by what planes so rough count beside a kernel of a scale. O(n)."""
    for i in range(len(weights)):
        weights[i] *= by_roughness(scale, roughness[i])


@inside_kernels
def by_roughness(scale: float, roughness: float) -> float:
    """What a plane counts from which its points lie off so much, mean square, beside a kernel of a scale.

    Squared: a plane across an edge errs to one side for all that meet it, and to the same at each frame.
    """
    share = scale * scale / (scale * scale + roughness)
    return share * share


@inside_kernels
def put_figures(figures: FloatArray, scale: float, fraction: float, total: float, squares: float, used: float) -> None:
    """Write what is known of a step before it is taken."""
    figures[SCALE], figures[FRACTION] = scale, fraction
    figures[TOTAL], figures[SQUARES], figures[USED] = total, squares, used
    figures[ENERGY] = figures[MOTION] = 0.0


@inside_kernels
def learn(figures: FloatArray, limits: FloatArray, near: float) -> None:
    """Update scale and fraction of inliers by the sums of a step over so many points near their planes: EM."""
    learned = max(math.sqrt(figures[SQUARES] / figures[TOTAL]), limits[FLOOR])
    figures[SCALE] = max(learned, limits[STEEPEST] * figures[SCALE])
    least = limits[LEAST_FRACTION]
    figures[FRACTION] = min(max(figures[TOTAL] / near, least), 1.0 - least)


@inside_kernels
def _turned(T: FloatArray, points: FloatArray, i: int) -> tuple[float, float, float]:
    """A point turned by a pose, about the sensor."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@inside_kernels
def _aside(
    i: int,
    points: FloatArray,
    own: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distance: float,
    farthest: float,
    cosine: float,
    T: FloatArray,
) -> float:
    """Squared distance of a point from its foot within the plane; -1 where it is too far or its normal another one."""
    if not distance <= farthest:
        return -1.0
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return 0.0
    if own[i, 0] != 0.0 or own[i, 1] != 0.0 or own[i, 2] != 0.0:
        u, v, t = _turned(T, own, i)
        if abs(u * nx + v * ny + t * nz) < cosine:
            return -1.0
    x, y, z = _turned(T, points, i)
    h = (x + T[0, 3] - feet[i, 0]) * nx + (y + T[1, 3] - feet[i, 1]) * ny + (z + T[2, 3] - feet[i, 2]) * nz
    square: float = distance * distance - h * h
    return max(square, 0.0)


@inside_kernels
def _move(A: FloatArray, g: FloatArray, lever: float, least: float, T: FloatArray) -> float:
    """Solve the normal equations by Cholesky, in place, and move the pose; how far that moves the points."""
    turns, shifts = A[0, 0] + A[1, 1] + A[2, 2], A[3, 3] + A[4, 4] + A[5, 5]
    hold_free_shifts(A, int(np.int64(3)), least)
    for k in range(UNKNOWNS):
        A[k, k] += DAMPING * (turns if k < 3 else shifts) + 1e-300
    solve_in_place(A, g)
    x, y, z = -g[0], -g[1], -g[2]
    square = x * x + y * y + z * z
    turn_and_shift(T, x, y, z, -g[3], -g[4], -g[5])
    moved: float = math.sqrt(square * lever * lever + g[3] * g[3] + g[4] * g[4] + g[5] * g[5])
    return moved


@inside_kernels
def solve_in_place(A: FloatArray, g: FloatArray) -> None:
    """Solve normal equations, of which the lower half is given, by Cholesky; into the right-hand side."""
    count = len(g)
    for j in range(count):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        A[j, j] = math.sqrt(max(A[j, j], 1e-300))
        for i in range(j + 1, count):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for j in range(count):
        for k in range(j):
            g[j] -= A[j, k] * g[k]
        g[j] /= A[j, j]
    for j in range(count - 1, -1, -1):
        for k in range(j + 1, count):
            g[j] -= A[k, j] * g[k]
        g[j] /= A[j, j]


@inside_kernels
def turn_and_shift(T: FloatArray, x: float, y: float, z: float, u: float, v: float, w: float) -> None:
    """Turn a pose by a rotation vector about its own place, and move it: Rodrigues' formula."""
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    s, c = 1.0, 0.5
    if angle > 1e-8:
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    for k in range(3):
        a, b, d = T[0, k], T[1, k], T[2, k]
        # w x R and w x (w x R).
        p, q, r = y * d - z * b, z * a - x * d, x * b - y * a
        T[0, k] += s * p + c * (y * r - z * q)
        T[1, k] += s * q + c * (z * p - x * r)
        T[2, k] += s * r + c * (x * q - y * p)
    T[0, 3] += u
    T[1, 3] += v
    T[2, 3] += w
