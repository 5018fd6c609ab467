"""What of the sums may be rounding of the coordinates, so that a gap within it says nothing of the rotation.

A coordinate is known to eps of its distance from the origin, and to some eps where it was computed. So a side P (rows p
times the root of their weight) is known up to an error dP with ``|dP| <= g = 8 eps sqrt(sum w |p|^2)``, and
``H = Q^T P`` about the means up to

    |dH| <= g_p |Q| + |P| g_q + g_p g_q.

The middle one of the three terms of a line against its measured copy is the rounding of one times the noise of the
other: no product of noise, and yet no width. Of narrow matches the rotation about their length stands in the block of H
across it, and |P| and |Q| are what the sides reach across only: a strip is told from a line where it is wider than its
grain. Weights are in P and Q, and directions have no other origin than zero: their grain is 8 eps of their lengths.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray

Size = FloatArray | float
# Of source and target; an array holds them along its first axis.
Pair = tuple[Size, Size] | FloatArray

# Points that lie within this of each other, measured in their distance from the origin, are one point.
SAME_POINT = 8.0 * float(np.finfo(np.float64).eps)
# Gap lambda_1 - lambda_2, in units of the largest lambda_1 such data could have, below which the rotation is taken as
# undetermined. Points on a line leave some 1e-31, a strip 1e-7 as wide as long 1e-14; at this one the rotation is good
# to some 1e-6.
SMALLEST_GAP = 1e-20
# The same for a gap that is a difference of the eigenvalues: their rounding leaves 1e-16 and more.
SMALLEST_DIFFERENCE = 1e-12


def grain_of(weight: Size, away: Size, spread: Size) -> Size:
    """How far rounding may move a side: of ``sum w``, its mean's distance from the origin, and its spread."""
    grain: Size = SAME_POINT * np.hypot(np.sqrt(weight) * away, np.sqrt(spread))
    return grain


def rounding_of(grains: Pair, sizes: Pair) -> Size:
    """How far the products of two sides may be rounding: ``(g + a) (h + b) - a b``."""
    (g, h), (a, b) = grains, sizes
    return g * b + (a + g) * h


def across_floor(grains: Pair, across: Pair) -> Size:
    """Gap of narrow matches that is none, by their grain and what they reach across their length.

    Sides that do not correlate across, as points drawn about a line on both, leave rounding of their products.
    """
    return rounding_of(grains, across) + SMALLEST_DIFFERENCE * across[0] * across[1]
