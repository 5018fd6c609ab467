from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from dqreg._arrays import BoolArray, IntArray
from dqreg.kernels.maps.shift_counts import count_at_shifts, count_on_runs, runs_around

SHAPES = [(1, 1, 1.0), (9, 14, 0.3), (30, 17, 0.02), (12, 8, 0.9)]


def runs_of(marked: BoolArray) -> IntArray:
    edges = np.diff(np.pad(marked, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, begins = np.nonzero(edges > 0)
    return np.column_stack([rows, begins, np.nonzero(edges < 0)[1]])


@pytest.mark.parametrize(("height", "width", "share"), [*SHAPES, (7, 40, 0.1), (5, 5, 0.0)])
def test_runs_are_of_what_is_marked_and_what_is_beside_it(height: int, width: int, share: float) -> None:
    marked = np.random.default_rng(width).random((height, width)) < share
    around = ndimage.binary_dilation(np.pad(marked, (0, 1)), np.ones((3, 3), dtype=bool))
    np.testing.assert_array_equal(runs_around(marked), runs_of(around))


@pytest.mark.parametrize(("height", "width", "share"), SHAPES)
def test_cells_that_a_shift_puts_onto_marked_ones_are_counted(height: int, width: int, share: float) -> None:
    # Oracle: every shift by itself, in a grid with room for it.
    rng = np.random.default_rng(height)
    grid, marked = rng.random((2, height, width)) < share
    cells, low, high = np.column_stack(np.nonzero(grid)), np.array([-5, -3]), np.array([4, 6])
    wide = np.pad(marked, 8)
    shifts = np.stack(np.meshgrid(*map(np.arange, low, high + 1), indexing="ij"), axis=-1)
    expected = wide[tuple((8 + shifts[:, :, None] + cells).transpose(3, 0, 1, 2))].sum(axis=2)
    counts = np.zeros(high - low + (1, 2), dtype=np.int32)
    count_on_runs(cells, runs_of(marked), low, counts)
    np.testing.assert_array_equal(counts[:, :-1], expected)
    each = np.zeros(expected.size, dtype=np.int32)
    count_at_shifts(0, expected.size, shifts.reshape(-1, 2), cells, marked, each)
    np.testing.assert_array_equal(each, expected.ravel())
