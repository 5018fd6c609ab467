"""Areas of the faces with each orientation, added up in a table."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.meshes.side_parity import scrambled


@compiled
def areas_by_direction(normals: FloatArray, areas: FloatArray, parts: int, codes: IntArray, sums: FloatArray) -> None:
    """Add each area, (f,), to the sum of its direction: where its normal, in so many parts of one, rounds to.

    A direction is a number, its digits to the base ``2 parts + 1``; codes, (n,) with n a power of two above f, are
    those numbers plus one, and zero where a row of the table is empty. O(f).
    """
    base, last = 2 * parts + 1, np.int64(len(codes) - 1)
    for f in range(len(areas)):
        code = np.int64(0)
        for k in range(3):
            code = code * base + np.int64(np.rint(normals[f, k] * parts)) + parts
        code += 1
        place = np.int64(scrambled(np.uint64(code)) & np.uint64(last))
        while codes[place] != 0 and codes[place] != code:
            place = (place + 1) & last
        codes[place] = code
        sums[place] += areas[f]
