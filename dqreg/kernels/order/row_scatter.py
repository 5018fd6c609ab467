"""Results of some rows, scattered to their places among all."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def scatter_rows(
    rows: IntArray,
    values: FloatArray,
    places: FloatArray,
    numbers: IntArray,
    all_values: FloatArray,
    all_places: FloatArray,
    all_numbers: IntArray,
) -> None:
    """Write values (m,), places (m, 3) and numbers (m,) to their rows among all: a place in memory is visited once."""
    for i in range(len(rows)):
        row = rows[i]
        all_values[row], all_numbers[row] = values[i], numbers[i]
        for k in range(3):
            all_places[row, k] = places[i, k]
