"""One step of many poses at once: planes looked up on a grid, normal equations of points to planes, their solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.steps.plane_steps import solve_in_place
from dqreg.kernels.steps.pose_forms import TINY


@compiled
def grid_planes(
    first: int,
    last: int,
    points: FloatArray,
    low: FloatArray,
    cell: float,
    shape: IntArray,
    planes: NDArray[np.float32],
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    nodes: IntArray,
) -> None:
    """Write foot, normal, distance and node of points first to last on the planes of their nearest nodes. O(1) a point.

    Outside of the grid the distance is infinite, and the node the number of all. Shapes: planes (nodes + 1, 6), a point
    and a normal a row; the others (n, 3) and (n,).
    """
    rows, columns, outside, half = shape[1], shape[2], len(planes) - 1, np.float32(0.0)
    for i in range(first, last):
        # In single precision, as the grid's own lookups: both shall find the same node.
        a = np.float32((points[i, 0] - low[0]) / cell + 0.5)
        b = np.float32((points[i, 1] - low[1]) / cell + 0.5)
        c = np.float32((points[i, 2] - low[2]) / cell + 0.5)
        node = outside
        if a >= half and b >= half and c >= half and a < shape[0] and b < rows and c < columns:
            node = (np.int64(a) * rows + np.int64(b)) * columns + np.int64(c)
        nx, ny, nz = float(planes[node, 3]), float(planes[node, 4]), float(planes[node, 5])
        x, y, z = points[i, 0] - planes[node, 0], points[i, 1] - planes[node, 1], points[i, 2] - planes[node, 2]
        height = x * nx + y * ny + z * nz
        # The point is the node's: it may be as far aside as the node.
        aside = max(np.sqrt(max(x * x + y * y + z * z - height * height, 0.0)) - cell, 0.0)
        nodes[i] = node
        distances[i] = np.inf if node == outside else np.sqrt(height * height + aside * aside)
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
        feet[i, 0], feet[i, 1] = points[i, 0] - height * nx, points[i, 1] - height * ny
        feet[i, 2] = points[i, 2] - height * nz


@compiled
def grid_places(
    first: int,
    last: int,
    points: FloatArray,
    low: FloatArray,
    cell: float,
    shape: IntArray,
    held: NDArray[np.int32],
    known: FloatArray,
    places: FloatArray,
    distances: FloatArray,
) -> None:
    """Write the known place, (m, 3), that the nearest node of each of points first to last holds, and its distance.

    Less the cell, by which the place may be the node's; infinite outside of the grid. O(1) a point. Shapes: held
    (nodes,), the others (n, 3) and (n,).
    """
    rows, columns = shape[1], shape[2]
    for i in range(first, last):
        a, b = (points[i, 0] - low[0]) / cell + 0.5, (points[i, 1] - low[1]) / cell + 0.5
        c = (points[i, 2] - low[2]) / cell + 0.5
        if not (a >= 0.0 and b >= 0.0 and c >= 0.0 and a < shape[0] and b < rows and c < columns):
            distances[i] = np.inf
            continue
        row, square = held[(np.int64(a) * rows + np.int64(b)) * columns + np.int64(c)], 0.0
        for k in range(3):
            places[i, k] = known[row, k]
            square += (points[i, k] - known[row, k]) ** 2
        distances[i] = max(np.sqrt(square) - cell, 0.0)


@compiled
def add_plane_steps(
    first: int,
    last: int,
    rotations: FloatArray,
    shifts: FloatArray,
    centres: FloatArray,
    points: FloatArray,
    directions: FloatArray,
    places: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    width: float,
    least: float,
    lever: float,
    share: float,
    squares: FloatArray,
    slopes: FloatArray,
) -> None:
    """Add the normal equations of poses first to last: of rotations about their centres, and shifts, in levers.

    A point weighs ``share exp(-(d / width)^2 / 2)``, or nothing where the cosine between its turned direction and the
    normal is at most ``least``. Without normals its turned direction is the plane's. O(1) a point and pose.

    Shapes: rotations (n, 3, 3), shifts, centres (n, 3); points, directions (m, 3); places, normals (n m, 3) or (0, 3),
    distances (n m,); squares (n, 6, 6), slopes (n, 6).
    """
    count, J = len(points), np.zeros(6)
    for k in range(first, last):
        r = rotations[k]
        for i in range(count):
            row = k * count + i
            d = distances[row] / width
            weight = share * np.exp(-0.5 * d * d)
            if weight == 0.0:
                continue
            p, q, s = directions[i, 0], directions[i, 1], directions[i, 2]
            nx = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s
            ny = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s
            nz = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s
            if len(normals) > 0:
                u, v, w = normals[row, 0], normals[row, 1], normals[row, 2]
                # A point whose direction is unknown passes.
                known = p != 0.0 or q != 0.0 or s != 0.0
                if known and abs(nx * u + ny * v + nz * w) <= least:
                    continue
                nx, ny, nz = u, v, w
            p, q, s = points[i, 0], points[i, 1], points[i, 2]
            x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + shifts[k, 0]
            y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + shifts[k, 1]
            z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + shifts[k, 2]
            residual = ((x - places[row, 0]) * nx + (y - places[row, 1]) * ny + (z - places[row, 2]) * nz) / lever
            x, y, z = (x - centres[k, 0]) / lever, (y - centres[k, 1]) / lever, (z - centres[k, 2]) / lever
            J[0], J[1], J[2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
            J[3], J[4], J[5] = nx, ny, nz
            for a in range(6):
                weighted = weight * J[a]
                slopes[k, a] += weighted * residual
                for b in range(a + 1):
                    squares[k, a, b] += weighted * J[b]
        for a in range(6):
            for b in range(a):
                squares[k, b, a] = squares[k, a, b]


@compiled
def take_damped_steps(
    first: int,
    last: int,
    rotations: FloatArray,
    shifts: FloatArray,
    centres: FloatArray,
    squares: FloatArray,
    slopes: FloatArray,
    lever: float,
    damping: float,
    least: float,
    turned: FloatArray,
    shifted: FloatArray,
) -> None:
    """Write poses first to last after the steps that solve their normal equations, by Cholesky's decomposition.

    Each equation is damped by a share of its mean diagonal, and by so much at least. Shapes: rotations (n, 3, 3),
    shifts and centres (n, 3), squares (n, 6, 6), slopes (n, 6).
    """
    A, step, turn = np.zeros((6, 6)), np.zeros(6), np.zeros((3, 3))
    for k in range(first, last):
        scale = 0.0
        for a in range(6):
            scale += squares[k, a, a]
        damped = max(damping * scale / 6.0, least)
        for a in range(6):
            step[a] = -slopes[k, a]
            for b in range(a + 1):
                A[a, b] = squares[k, a, b] + (damped if a == b else 0.0)
        solve_in_place(A, step)
        _write_rotation(step, turn)
        for a in range(3):
            shifted[k, a] = centres[k, a] + lever * step[3 + a]
            for b in range(3):
                shifted[k, a] += turn[a, b] * (shifts[k, b] - centres[k, b])
                turned[k, a, b] = (
                    turn[a, 0] * rotations[k, 0, b] + turn[a, 1] * rotations[k, 1, b] + turn[a, 2] * rotations[k, 2, b]
                )


@inside_kernels
def _write_rotation(vector: FloatArray, turn: FloatArray) -> None:
    """Write the matrix of a rotation vector: Rodrigues' formula."""
    angle = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    inverse = 1.0 / max(angle, TINY)
    x, y, z = vector[0] * inverse, vector[1] * inverse, vector[2] * inverse
    s, c = np.sin(angle), 1.0 - np.cos(angle)
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
