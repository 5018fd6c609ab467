"""Points of some correspondences displaced along the normals, and how far residuals follow: see `followed_by`."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.selection import median_of


@compiled
def displaced_rows(
    weights: FloatArray,
    moved: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    scale: float,
    limit: float,
    rows: IntArray,
    points: FloatArray,
) -> tuple[int, float]:
    """Write points displaced by the usual size of their residuals, forwards and then, as many, backwards. O(n).

    Of rows with weight and normal as many as half of the places, evenly spread; the size is their median residual
    along the normal times a scale, and what is farther off than a limit of sizes is left out. Returned are how many
    were written each way, and the size; zeros where there is none. Shapes: moved, feet and normals (n, 3), rows (2 m,),
    points (2 m, 3).
    """
    count, most, found, seen = 0, len(rows) // 2, 0, 0
    for i in range(len(weights)):
        if weights[i] > 0.0 and (normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0):
            count += 1
    chosen = min(most, count)
    if chosen == 0:
        return 0, 0.0
    residuals, step = np.zeros(chosen), (count - 1) / max(chosen - 1, 1)
    for i in range(len(weights)):
        if weights[i] > 0.0 and (normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0):
            if seen == np.rint(found * step) and found < chosen:
                along = (moved[i, 0] - feet[i, 0]) * normals[i, 0] + (moved[i, 1] - feet[i, 1]) * normals[i, 1]
                residuals[found] = abs(along + (moved[i, 2] - feet[i, 2]) * normals[i, 2])
                rows[found] = i
                found += 1
            seen += 1
    size = scale * median_of(residuals.copy())
    if not size > 0.0:
        return 0, 0.0
    kept = 0
    for k in range(found):
        if residuals[k] <= limit * size:
            rows[kept] = rows[k]
            kept += 1
    for k in range(kept):
        i = rows[kept + k] = rows[k]
        for axis in range(3):
            points[k, axis] = moved[i, axis] + size * normals[i, axis]
            points[kept + k, axis] = moved[i, axis] - size * normals[i, axis]
    return kept, size


@compiled
def followed_share(
    points: FloatArray, feet: FloatArray, normals: FloatArray, before: FloatArray, size: float, limit: float
) -> float:
    """Share of a displacement by a size, forwards and as many rows backwards, that is left of it over new planes. O(n).

    Their normals have the sign of those before; a residual counts up to a limit of sizes. Shapes: (2 m, 3) each.
    """
    half, total = len(points) // 2, 0.0
    for i in range(len(points)):
        along, same = 0.0, 0.0
        for axis in range(3):
            along += (points[i, axis] - feet[i, axis]) * normals[i, axis]
            same += normals[i, axis] * before[i, axis]
        along = min(max(-along if same < 0.0 else along, -limit * size), limit * size)
        total += along if i < half else -along
    return total / (size * len(points))
