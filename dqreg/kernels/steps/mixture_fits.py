"""The mixture of inliers and outliers learned from distances: rounds of EM, with exponentials of many numbers at once.

A loop that calls the exponential of the C library takes it number by number; this one the processor takes side by side,
and its digits are the same on every machine.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Numbers at a time: what they need stays in the nearest cache. And sums that run beside each other.
BLOCK, LANES = 256, 8
# Below this the exponential is none.
LEAST_EXPONENT = -708.0
# The logarithm of two in two parts, of which the first has zeros at its end, and what rounds to a whole number when it
# is added: that number stands in the last bits then.
LOG2_HIGH, LOG2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
ROUNDING = 6755399441055744.0
LOG2_INVERSE = 1.0 / math.log(2.0)
# Bits below the exponent of a number.
FRACTION_BITS = 52
# Terms of the series: one over the factorials.
SERIES_TERMS = tuple(1.0 / math.factorial(k) for k in range(14))


@inside_kernels
def exponentials(values: FloatArray, count: int, steps: FloatArray, found: FloatArray) -> None:
    """Write the exponentials of the first numbers, none above zero, to 2 units in the last place. O(n).

    Each array (m,). No branch and no call, so that many are taken at once.
    """
    whole, bits, terms = steps.view(np.int64), found.view(np.int64), SERIES_TERMS
    for i in range(count):
        value = max(values[i], LEAST_EXPONENT)
        shifted = value * LOG2_INVERSE + ROUNDING
        steps[i] = shifted
        twos = shifted - ROUNDING
        r = (value - twos * LOG2_HIGH) - twos * LOG2_LOW
        square = r * r
        fourth = square * square
        low = ((1.0 + r) + (0.5 + r * terms[3]) * square) + (
            (terms[4] + r * terms[5]) + (terms[6] + r * terms[7]) * square
        ) * fourth
        high = ((terms[8] + r * terms[9]) + (terms[10] + r * terms[11]) * square) + (terms[12] + r * terms[13]) * fourth
        found[i] = low + high * (fourth * fourth)
    for i in range(count):
        bits[i] += whole[i] << FRACTION_BITS
    for i in range(count):
        found[i] = found[i] if values[i] >= LEAST_EXPONENT else 0.0


@inside_kernels
def weighed_squares(
    squares: FloatArray, factor: float, odds: float, memory: FloatArray, sums: FloatArray
) -> tuple[float, float]:
    """Sum of the weights of squared distances, and of the squares so weighted. O(n).

    Shapes: memory (3, m), sums (2, k).
    """
    sums[:] = 0.0
    values, steps, weights = memory[0], memory[1], memory[2]
    for first in range(0, len(squares), BLOCK):
        some = squares[first : first + BLOCK]
        count = len(some)
        for i in range(count):
            values[i] = some[i] * factor
        exponentials(values, count, steps, weights)
        for i in range(count):
            weights[i] = weights[i] / (weights[i] + odds)
            values[i] = weights[i] * some[i]
        whole = count - count % LANES
        for i in range(0, whole, LANES):
            for k in range(LANES):
                sums[0, k] += weights[i + k]
                sums[1, k] += values[i + k]
        for i in range(whole, count):
            sums[0, i - whole] += weights[i]
            sums[1, i - whole] += values[i]
    total, square = 0.0, 0.0
    for k in range(LANES):
        total, square = total + sums[0, k], square + sums[1, k]
    return total, square


@compiled
def fit_mixture(
    distances: FloatArray,
    scale: float,
    fraction: float,
    limit: float,
    rounds: int,
    peak: float,
    least_scale: float,
    least_fraction: float,
    least_factor: float,
    settled: float,
) -> tuple[float, float]:
    """Scale and inlier fraction after rounds of EM on distances, (n,), see `InlierMixture`. O(n) a round.

    The peak is one over the density of an inlier at distance zero; below a share of change it is settled.
    """
    squares, memory, sums = np.zeros(len(distances)), np.zeros((3, BLOCK)), np.zeros((2, LANES))
    for i in range(len(distances)):
        squares[i] = distances[i] * distances[i]
    for _ in range(rounds):
        odds = (1.0 - fraction) / limit * scale * peak / fraction
        total, square = weighed_squares(squares, max(-0.5 / scale / scale, least_factor), odds, memory, sums)
        if total == 0.0:
            break
        was_scale, was_fraction = scale, fraction
        scale = max(math.sqrt(square / total), least_scale)
        fraction = min(max(total / len(distances), least_fraction), 1.0 - least_fraction)
        is_still = abs(scale - was_scale) <= settled * scale
        if is_still and abs(fraction - was_fraction) <= settled * fraction:
            break
    return scale, fraction
