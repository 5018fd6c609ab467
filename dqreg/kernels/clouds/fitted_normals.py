"""What the planes of a scan's neighbourhoods tell of its normals: their variances, and which lie across an edge."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.threads import as_plain


def variances_of_normals(residuals: FloatArray, levers: FloatArray, neighbours: int) -> FloatArray:
    """Variances of normals fitted to so many neighbours, rad^2, (n,): 0 where it is not known, 1 without a lever."""
    variances = np.zeros(len(residuals))
    normal_variances(as_plain(residuals), as_plain(levers), float(neighbours), variances)
    return variances


def rough_planes(residuals: FloatArray, levers: FloatArray, most: float) -> tuple[IntArray, int]:
    """Rows of planes that leave more than a share of their lever's length, (k,), of how many planes."""
    rows = np.zeros(len(levers), dtype=np.int64)
    count, known = rough_rows(as_plain(residuals), as_plain(levers), most, rows)
    return rows[:count], known


@compiled
def normal_variances(residuals: FloatArray, levers: FloatArray, neighbours: float, variances: FloatArray) -> None:
    """Write what `variances_of_normals` says, (n,). O(n)."""
    for i in range(len(residuals)):
        variance = residuals[i] * residuals[i] / (neighbours * levers[i])
        variances[i] = (1.0 if variance == math.inf else variance) if not math.isnan(variance) else 0.0


@compiled
def rough_rows(residuals: FloatArray, levers: FloatArray, most: float, rows: IntArray) -> tuple[int, int]:
    """Write what `rough_planes` says, (n,); returns how many, and of how many. O(n)."""
    count, known = 0, 0
    for i in range(len(residuals)):
        if levers[i] > 0.0:
            known += 1
            if residuals[i] > most * math.sqrt(levers[i]):
                rows[count] = i
                count += 1
    return count, known
