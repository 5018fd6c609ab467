"""Planes of a map in voxels, of the sums of the cells around a place: no neighbour is searched for."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.maps.cells_around import COLUMNS, ROOM, WIDEST, cells_around
from dqreg.kernels.maps.voxel_blocks import Voxels
from dqreg.kernels.maps.voxel_nearest import nearest_in_voxels
from dqreg.kernels.maps.voxel_points import CELLS, Slots

# Points of a plane at least, and the share of the largest variance that the second one has at least: less is a line.
FEWEST, LINE = 5.0, 0.02
# Points from which on no more are looked for.
ENOUGH = 12.0
# What points of a cell count, by how many cells around one are looked through and how many steps it is from that.
GRADES = 0.5 ** (np.arange(3 * WIDEST + 1) / np.maximum(np.arange(WIDEST + 1), 1)[:, None])
# Directions within a plane, of which each moment is a sum of those of the axes: cosines and sines of each.
ANGLES = np.pi * np.arange(8) / 8
COS, SIN = np.cos(ANGLES), np.sin(ANGLES)
SECOND = np.stack([COS**2, 2.0 * COS * SIN, SIN**2], axis=1)
THIRD = np.stack([COS**3, 3.0 * COS**2 * SIN, 3.0 * COS * SIN**2, SIN**3], axis=1)
FOURTH = np.stack([COS**4, 4.0 * COS**3 * SIN, 6.0 * COS**2 * SIN**2, 4.0 * COS * SIN**3, SIN**4], axis=1)
# Least spread below which points lie on two lines: of two rings that lie on two faces the plane is of neither, and they
# lie on it all the same. It is taken to be so rough, in cells squared.
TWO_LINES, BETWEEN_LINES = 0.1, 0.04
# Steps of Newton's method at most, and the step over the trace that is the last.
ROUNDS, STILL = 20, 1e-14
# A plane stands one state more for each so many points, and so many at most: the last frames, which were placed by it,
# do not pull it along at once. Over ten frames that errs less than planes that are fitted anew at each.
KEPT, LONGEST = 4.0, 8.0
# What no other is nearer than, less what slots are rounded by.
ROUNDED = 1.0 - 1e-6


@inside_kernels
def fit_cell(
    cell: int,
    a: int,
    b: int,
    c: int,
    size: float,
    thin: float,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    sums: Slots,
    planes: FloatArray,
    state: int,
    normal: FloatArray,
    around: IntArray,
) -> None:
    """Write the plane of the points in the cells around one: normal, zero where they fix none, variance.

    Then their middle, through which it goes, and their mean squared distance from it.

    As far around as it takes for enough of them that are no line: one cell where frames came before, more where there
    is one sweep. And the state of the map until which it stands: the more points, the less the next frames change it.
    ``around`` is room for `cells_around`.
    """
    variance, full = np.inf, 0.0
    for reach in range(1, WIDEST + 1):
        count, full = cells_around(a, b, c, reach, table, keys, cells, around), 0.0
        for k in range(count):
            full += sums[around[k, 0], 0]
        # Of fewer no plane is kept but the widest.
        if full < ENOUGH and reach < WIDEST:
            continue
        variance = _plane_of(count, around, reach, 0.5 * size, thin, sums, normal) if full >= FEWEST else np.inf
        if variance < np.inf and full >= ENOUGH:
            break
    if not variance < np.inf:
        normal[:] = 0.0
    half = 0.5 * size
    # No other than what threads that meet here write, and the state last.
    planes[cell, 0], planes[cell, 1], planes[cell, 2], planes[cell, 3] = normal[0], normal[1], normal[2], variance
    planes[cell, 5], planes[cell, 6] = (a + 0.5) * half + normal[3], (b + 0.5) * half + normal[4]
    planes[cell, 7], planes[cell, 8] = (c + 0.5) * half + normal[5], normal[6]
    planes[cell, 4] = state + 1.0 + min(np.floor(full / KEPT), LONGEST)


@inside_kernels
def _plane_of(
    count: int, around: IntArray, reach: int, half: float, thin: float, sums: Slots, normal: FloatArray
) -> float:
    """Write normal, middle from that of the cell, and roughness of the points in the cells around it; variance of it.

    What is there is seen best by its own cell: those of others count half as much for as many steps from it as
    there are to the farthest cell along an axis.
    """
    n = square = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for k in range(count):
        s, i, j, m = around[k, 0], around[k, 1], around[k, 2], around[k, 3]
        g = GRADES[reach, abs(i) + abs(j) + abs(m)]
        w, x, y, z = float(sums[s, 0]), float(sums[s, 1]), float(sums[s, 2]), float(sums[s, 3])
        u, v, t = i * half, j * half, m * half
        n, square = n + g * w, square + g * g * w
        sx, sy, sz = sx + g * (x + w * u), sy + g * (y + w * v), sz + g * (z + w * t)
        xx += g * (sums[s, 4] + u * (2.0 * x + w * u))
        yy += g * (sums[s, 5] + v * (2.0 * y + w * v))
        zz += g * (sums[s, 6] + t * (2.0 * z + w * t))
        xy += g * (sums[s, 7] + u * y + v * x + w * u * v)
        xz += g * (sums[s, 8] + u * z + t * x + w * u * t)
        yz += g * (sums[s, 9] + v * z + t * y + w * v * t)
    sx, sy, sz = sx / n, sy / n, sz / n
    normal[3], normal[4], normal[5] = sx, sy, sz
    xx, yy, zz = xx / n - sx * sx, yy / n - sy * sy, zz / n - sz * sz
    xy, xz, yz = xy / n - sx * sy, xz / n - sx * sz, yz / n - sy * sz
    # As many points of equal weight would tell as much.
    variance = _thinnest(xx, yy, zz, xy, xz, yz, n * n / square, thin, normal)
    if variance < np.inf and _least_spread(count, around, reach, half, sums, normal) < TWO_LINES:
        normal[6] = max(normal[6], BETWEEN_LINES * half * half)
    return variance


@inside_kernels
def _least_spread(count: int, around: IntArray, reach: int, half: float, sums: Slots, normal: FloatArray) -> float:
    """How far the middles of cells are from lying on two lines within a plane: 0 where they do, 2 of a normal spread.

    The kurtosis less one and the squared skewness, in the direction where that is least: Pearson's inequality, an
    equation for two values alone. The plane and the middle are those of `_plane_of`.
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    # Two axes within the plane.
    ux, uy, uz = (ny, -nx, 0.0) if abs(nz) < 0.9 else (0.0, nz, -ny)
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    n = uu = uv = vv = uuu = uuv = uvv = vvv = uuuu = uuuv = uuvv = uvvv = vvvv = 0.0
    for k in range(count):
        row, i, j, m = around[k, 0], around[k, 1], around[k, 2], around[k, 3]
        held = float(sums[row, 0])
        w, each = held * GRADES[reach, abs(i) + abs(j) + abs(m)], 1.0 / held
        x = each * float(sums[row, 1]) + i * half - normal[3]
        y = each * float(sums[row, 2]) + j * half - normal[4]
        z = each * float(sums[row, 3]) + m * half - normal[5]
        u, v = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
        a, b, c = u * u, u * v, v * v
        n, uu, uv, vv = n + w, uu + w * a, uv + w * b, vv + w * c
        uuu, uuv, uvv, vvv = uuu + w * a * u, uuv + w * a * v, uvv + w * c * u, vvv + w * c * v
        uuuu, uuuv, uuvv = uuuu + w * a * a, uuuv + w * a * b, uuvv + w * a * c
        uvvv, vvvv = uvvv + w * b * c, vvvv + w * c * c
    least = np.inf
    for d in range(len(SECOND)):
        second = (SECOND[d, 0] * uu + SECOND[d, 1] * uv + SECOND[d, 2] * vv) / n
        third = (THIRD[d, 0] * uuu + THIRD[d, 1] * uuv + THIRD[d, 2] * uvv + THIRD[d, 3] * vvv) / n
        fourth = FOURTH[d, 0] * uuuu + FOURTH[d, 1] * uuuv + FOURTH[d, 2] * uuvv
        fourth = (fourth + FOURTH[d, 3] * uvvv + FOURTH[d, 4] * vvvv) / n
        if second > 0.0:
            square = second * second
            least = min(least, (fourth - third * third / second) / square - 1.0)
    return least


@inside_kernels
def _thinnest(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float, count: float, thin: float, normal: FloatArray
) -> float:
    """Write the axis of the least eigenvalue of a covariance, and that; zero where it is a line's. Its variance.

    What is wide by noise alone is a line as well: the second eigenvalue has to be more than ``thin``.

    The eigenvalue by Newton's method on the characteristic polynomial from below, where it is convex and falls: each
    step stays below the root. The axis is a row of the adjugate of what is left.
    """
    trace = xx + yy + zz
    minors = xx * yy + xx * zz + yy * zz - xy * xy - xz * xz - yz * yz
    whole = xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
    root = 0.0
    for _ in range(ROUNDS):
        value = ((root - trace) * root + minors) * root - whole
        slope = (3.0 * root - 2.0 * trace) * root + minors
        if not slope > 0.0:
            break
        step = -value / slope
        root += step
        if not step > STILL * trace:
            break
    root = max(root, 0.0)
    a, b, c = xx - root, yy - root, zz - root
    # Rows of the adjugate: all along the axis, the one with the largest diagonal element is the longest.
    p, q, r = b * c - yz * yz, a * c - xz * xz, a * b - xy * xy
    if p >= q and p >= r:
        x, y, z = p, xz * yz - xy * c, xy * yz - xz * b
    elif q >= r:
        x, y, z = xz * yz - xy * c, q, xy * xz - yz * a
    else:
        x, y, z = xy * yz - xz * b, xy * xz - yz * a, r
    # The two others: their sum and their product.
    total, product = trace - root, minors - root * (trace - root)
    large = 0.5 * (total + np.sqrt(max(total * total - 4.0 * product, 0.0)))
    small = total - large
    length = np.sqrt(x * x + y * y + z * z)
    if not small > max(LINE * large, thin) or not length > 0.0:
        return np.inf
    normal[0], normal[1], normal[2], normal[6] = x / length, y / length, z / length, root
    variance: float = root / count * (1.0 / small + 1.0 / large)
    return variance


@compiled
def closest_in_voxels(
    first: int,
    last: int,
    queries: FloatArray,
    within: float,
    size: float,
    thin: float,
    points: FloatArray,
    links: IntArray,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    sums: Slots,
    planes: FloatArray,
    state: int,
    before: FloatArray,
    others_before: FloatArray,
    shrink: float,
    tolerance: float,
    rows: IntArray,
    distances: FloatArray,
    others: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    variances: FloatArray,
) -> None:
    """Write nearest points of queries first to last, (m, 3), and normals there with their variances. O(1) each.

    Where none is nearer than ``within``, the row is -1, the distance that, the point the query and the normal zero.
    Planes are kept by cells, (8 v, 9), as `fit_cell` writes them. Rows that were the nearest at other places, (m, 3) or
    (0, 3), are kept where no other can be nearer by more than a tolerance.
    """
    best, normal, half = np.zeros(2), np.zeros(7), 0.5 * size
    around = np.zeros((ROOM, COLUMNS), np.int64)
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        row, again = rows[i], True
        if len(before) > 0 and row >= 0:
            dx, dy, dz = x - points[row, 0], y - points[row, 1], z - points[row, 2]
            distances[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = x - before[i, 0], y - before[i, 1], z - before[i, 2]
            others[i] = (others_before[i] - np.sqrt(dx * dx + dy * dy + dz * dz)) * shrink
            again = distances[i] >= others[i] + tolerance
            if not again:
                continue
        if again:
            row = nearest_in_voxels(
                x, y, z, within, size, points, links, table, keys, cells, voxels, slots, members, best
            )
            rows[i], distances[i], others[i] = row, np.sqrt(best[0]), np.sqrt(best[1]) * ROUNDED
            if row >= 0:
                dx, dy, dz = x - points[row, 0], y - points[row, 1], z - points[row, 2]
                distances[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
        if row < 0:
            feet[i, 0], feet[i, 1], feet[i, 2], variances[i] = x, y, z, np.inf
            normals[i, 0] = normals[i, 1] = normals[i, 2] = 0.0
            continue
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        a, b, c = int(np.floor(x / half)), int(np.floor(y / half)), int(np.floor(z / half))
        cell = int(links[row, 1]) * CELLS + 4 * (a & 1) + 2 * (b & 1) + (c & 1)
        if planes[cell, 4] <= state:
            fit_cell(cell, a, b, c, size, thin, table, keys, cells, sums, planes, state, normal, around)
        for k in range(3):
            feet[i, k], normals[i, k] = points[row, k], planes[cell, k]
        variances[i] = planes[cell, 3]
