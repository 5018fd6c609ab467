"""Steps of a pose and of the motion during its sweep onto planes held fixed, both at once: EM and Gauss-Newton."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.steps.free_shifts import hold_free_shifts
from dqreg.kernels.steps.plane_steps import (
    ENOUGH,
    FARTHEST,
    FRACTION,
    LEAST_INFORMATION,
    LEVER,
    MOTION,
    SCALE,
    by_roughness,
    learn,
    put_figures,
    solve_in_place,
    turn_and_shift,
)
from dqreg.kernels.steps.row_products import (
    COLUMNS,
    FACTOR,
    LANES,
    PRODUCTS,
    RIGHT,
    UNKNOWNS,
    WEIGHT,
    add_rows,
    place_sums,
)

# Place among the limits, after those of both kernels: share of the weights that has to face a motion for it to count;
# at this share, half of it is believed in a step.
HELD = 9


@compiled
def step_on_planes_of_sweep(
    points: FloatArray,
    back: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    variances: FloatArray,
    roughness: FloatArray,
    limits: FloatArray,
    steps: int,
    T: FloatArray,
    change: FloatArray,
    weights: FloatArray,
    figures: FloatArray,
) -> None:
    """Move a pose, (4, 4), and a twist of the sensor during the sweep, (6,), as `step_on_planes` moves a pose.

    A point of time s, -1 to 0, lies at ``T (x + s (w x x + v))``, with the twist (w, v) in the axes of the sensor.
    Points without a plane count as the others do on average, and no energy is asked. O(steps n).
    """
    count, unknowns = len(points), 2 * UNKNOWNS
    farthest, scale, fraction, lever = limits[FARTHEST], limits[SCALE], limits[FRACTION], limits[LEVER]
    A, g = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    # Of the type of other numbers: for each plain one what it is given to would be compiled once more.
    none, twist, shift = int(np.int64(0)), int(np.int64(UNKNOWNS)), int(np.int64(3))
    rows, sums = np.zeros((COLUMNS, LANES)), np.zeros((3, PRODUCTS, LANES))
    for _ in range(steps):
        odds = (1.0 - fraction) / farthest * scale * math.sqrt(0.5 * math.pi) / fraction
        sums[:], waiting = 0.0, 0
        total, squares, used, near = 0.0, 0.0, 0.0, 0.0
        whole, first, second, noise = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            weights[i] = 0.0
            if not distances[i] <= farthest:
                continue
            nx, ny, nz, s = normals[i, 0], normals[i, 1], normals[i, 2], back[i]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                weights[i] = fraction
                continue
            x, y, z = _seen(points, i, s, change, T)
            h = (x + T[0, 3] - feet[i, 0]) * nx + (y + T[1, 3] - feet[i, 1]) * ny + (z + T[2, 3] - feet[i, 2]) * nz
            if h * h > farthest * farthest:
                continue
            near += 1.0
            density = math.exp(-0.5 * h * h / (scale * scale))
            w = density / (density + odds)
            weights[i] = w
            total, squares, used = total + w, squares + w * h * h, used + (1.0 if w > 0.0 else 0.0)
            w *= by_roughness(scale, roughness[i])
            whole, first, second = whole + w, first + w * s, second + w * s * s
            noise += w * min(variances[i], 1.0)
            rows[0, waiting], rows[1, waiting] = (y * nz - z * ny) / lever, (z * nx - x * nz) / lever
            rows[2, waiting] = (x * ny - y * nx) / lever
            rows[3, waiting], rows[4, waiting], rows[5, waiting] = nx, ny, nz
            rows[RIGHT, waiting], rows[WEIGHT, waiting], rows[FACTOR, waiting] = h, w, s
            waiting += 1
            if waiting == LANES:
                add_rows(rows, sums)
                waiting = 0
        rows[WEIGHT, waiting:] = 0.0
        add_rows(rows, sums)
        # The right-hand side of the twist is that of the second sums.
        place_sums(sums[2], A, g, twist, twist)
        place_sums(sums[1], A, g, twist, none)
        place_sums(sums[0], A, g, none, none)
        for k in range(UNKNOWNS):
            for j in range(k):
                A[UNKNOWNS + j, k] = A[UNKNOWNS + k, j]
        put_figures(figures, scale, fraction, total, squares, used)
        if used < unknowns or not whole > 0.0:
            return
        hold_free_shifts(A, shift, limits[LEAST_INFORMATION] * noise)
        hold_free_shifts(A, twist + shift, limits[LEAST_INFORMATION] * noise * second / whole)
        damping = limits[HELD] * max(second - first * first / whole, 0.0) + 1e-9 * whole
        for k in range(unknowns):
            A[k, k] += damping
        solve_in_place(A, g)
        figures[MOTION] = _move(g, lever, T, change)
        learn(figures, limits, near)
        if figures[MOTION] <= limits[ENOUGH]:
            return
        scale, fraction = figures[SCALE], figures[FRACTION]


@inside_kernels
def _seen(points: FloatArray, i: int, s: float, change: FloatArray, T: FloatArray) -> tuple[float, float, float]:
    """A point at the end of the sweep, about the sensor in the axes of the map."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    u = x + s * (change[1] * z - change[2] * y + change[3])
    v = y + s * (change[2] * x - change[0] * z + change[4])
    w = z + s * (change[0] * y - change[1] * x + change[5])
    return (
        T[0, 0] * u + T[0, 1] * v + T[0, 2] * w,
        T[1, 0] * u + T[1, 1] * v + T[1, 2] * w,
        T[2, 0] * u + T[2, 1] * v + T[2, 2] * w,
    )


@inside_kernels
def _move(g: FloatArray, lever: float, T: FloatArray, change: FloatArray) -> float:
    """Take back a step, turns times a lever, of pose and twist; how far that moves the points, about."""
    square = 0.0
    for k in range(2 * UNKNOWNS):
        square += g[k] * g[k]
    for k in range(3):
        change[k] -= (T[0, k] * g[6] + T[1, k] * g[7] + T[2, k] * g[8]) / lever
        change[3 + k] -= T[0, k] * g[9] + T[1, k] * g[10] + T[2, k] * g[11]
    turn_and_shift(T, -g[0] / lever, -g[1] / lever, -g[2] / lever, -g[3], -g[4], -g[5])
    moved: float = math.sqrt(square)
    return moved
