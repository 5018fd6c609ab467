from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.search.nearest_at_nodes import SIDE, nearest_at_nodes


@pytest.mark.parametrize("kind", ["even", "one", "line", "beyond"])
def test_nodes_hold_the_nearest_of_all_points_and_of_equally_near_ones_the_first(kind: str) -> None:
    # Oracle: all distances. Two blocks along two axes, neither of which they fill.
    shape = np.array([SIDE + 3, 5, SIDE + 1])
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, shape - 1.0, size=(150, 3))
    if kind == "one":
        points = points[:1]
    elif kind == "line":
        # Dense along an axis, halfway between nodes and so equally near to many, and twice each.
        points[:] = [4.0, 2.5, 0.0]
        points[:75, 2] = points[75:, 2] = np.arange(75) / 2.0
    elif kind == "beyond":
        points *= 3.0
    nodes = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
    held, squares = np.full(len(nodes), -1, dtype=np.int32), np.zeros(len(nodes), dtype=np.float32)
    for first, last in ((1, 4), (0, 1)):
        nearest_at_nodes(first, last, points, shape, held, squares)
    away = ((nodes[:, None] - points) ** 2).sum(axis=2)
    np.testing.assert_allclose(squares, away.min(axis=1), rtol=1e-6)
    # Exact along the line; else none is as near as another.
    np.testing.assert_array_equal(held, away.argmin(axis=1))
