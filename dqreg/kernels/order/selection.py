"""Numbers by their rank, without sorting the others."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.kd_order import MANY_KEYS, part_keys


@compiled
def ranked(values: FloatArray, rank: int) -> float:
    """The number of a rank, from 0, among finite values, which are moved: none before it is above, none behind below.

    O(n), see `part_keys`.
    """
    order, sample = np.zeros(len(values), np.int64), np.zeros(MANY_KEYS[1])
    first = rank - rank  # a literal 0 would be a type of its own
    part_keys(values, order, first, len(values) - 1, rank, sample)
    found: float = values[rank]
    return found


@compiled
def median_of(values: FloatArray) -> float:
    """Median of finite values, at least one, which are moved. O(n)."""
    half = len(values) // 2
    high = ranked(values, half)
    if len(values) % 2:
        return high
    low = float(values[0])
    for i in range(1, half):
        low = max(low, values[i])
    return 0.5 * (low + high)


@compiled
def quantile_of(values: FloatArray, share: float) -> float:
    """Quantile of the same, between the two nearest, from the nearer of these. O(n)."""
    place = share * (len(values) - 1)
    below = int(place)
    part, low = place - below, ranked(values, below)
    if below + 1 >= len(values):
        return low
    high = float(values[below + 1])
    for i in range(below + 2, len(values)):
        high = min(high, values[i])
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1.0 - part)
