"""What the planes of a scan's neighbourhoods tell of its normals: their variances, and which lie across an edge."""

from __future__ import annotations

import math

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled


@compiled
def normal_variances(residuals: FloatArray, levers: FloatArray, neighbours: float, variances: FloatArray) -> None:
    """Write the variances of normals fitted to so many neighbours, rad^2, (n,): 0 unknown, 1 without a lever. O(n)."""
    for i in range(len(residuals)):
        variance = residuals[i] * residuals[i] / (neighbours * levers[i])
        variances[i] = (1.0 if variance == math.inf else variance) if not math.isnan(variance) else 0.0


@compiled
def rough_rows(residuals: FloatArray, levers: FloatArray, most: float, rows: IntArray) -> tuple[int, int]:
    """Write rows of planes that leave more than a share of their lever's length, (n,); how many, of how many. O(n)."""
    count, known = 0, 0
    for i in range(len(residuals)):
        if levers[i] > 0.0:
            known += 1
            if residuals[i] > most * math.sqrt(levers[i]):
                rows[count] = i
                count += 1
    return count, known
