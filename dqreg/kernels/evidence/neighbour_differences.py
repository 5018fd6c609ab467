"""Residuals of neighbouring points of one face: what they have in common, and how far they differ."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def neighbour_differences(
    residuals: FloatArray, normals: FloatArray, beside: IntArray, cosine: float, apart: FloatArray, sums: FloatArray
) -> int:
    """Write how far the residuals of pairs differ, in a row, and return how many pairs there are. O(n k).

    A pair is a point and one of its neighbours, a row or below zero for none, whose normals have a larger cosine. Their
    products and the means of their squares are added to two sums. Shapes: residuals (n,), normals (n, 3), beside (n,
    k), apart (n k,), sums (2,).
    """
    together, alone, count = 0.0, 0.0, 0
    for i in range(len(beside)):
        one = residuals[i]
        for k in range(beside.shape[1]):
            j = beside[i, k]
            if j < 0:
                continue
            same = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            if same > cosine:
                two = residuals[j]
                together += one * two
                alone += 0.5 * (one * one + two * two)
                apart[count] = abs(one - two)
                count += 1
    sums[0] += together
    sums[1] += alone
    return count
