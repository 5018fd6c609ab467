from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.maps.cells_around import COLUMNS, ROOM, cells_around
from dqreg.odometry.map_surface import MapSurface

SIZE = 0.4


@compiled
def around(a, b, c, reach, table, keys, cells, found):
    return cells_around(a, b, c, reach, table, keys, cells, found)


@pytest.mark.parametrize("reach", [1, 2, 4])
def test_the_cells_around_one_are_those_that_hold_points(reach: int) -> None:
    # Oracle: all cells of the points; the sums of each tell how many it holds.
    points = np.random.default_rng(reach).normal(size=(3000, 3)) * [4.0, 3.0, 0.3]
    surface, found = MapSurface(SIZE, 12, 3.0, points), np.zeros((ROOM, COLUMNS), dtype=np.int64)
    held, counts = np.unique(np.floor(points / (0.5 * SIZE)).astype(np.int64), axis=0, return_counts=True)
    for at in np.vstack([held[::150], [[-3, 7, 0], [100, 0, 0]]]):
        number = around(*at, reach, surface._table, surface._keys, surface._cells, found)
        steps, rows = found[:number, 1:], found[:number, 0]
        near = np.abs(held - at).max(axis=1) <= reach
        order = np.lexsort(steps.T[::-1])
        np.testing.assert_array_equal(steps[order], held[near] - at)
        np.testing.assert_array_equal(surface._sums.reshape(-1, 10)[rows[order], 0], counts[near])
