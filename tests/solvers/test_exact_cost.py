from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from dqreg.solvers import cost_of_pose, read_matches
from dqreg.solvers.exact_cost import CHUNK_ROWS, FEW_ROWS
from tests.solvers.problems import euclidean_cost, fast, problems
from tests.strategies import poses


@fast
@given(problems(), poses())
def test_it_is_the_cost_by_its_definition(problem, T):
    assert sum(cost_of_pose(T, read_matches(*problem.args))) == pytest.approx(euclidean_cost(T, problem), rel=1e-9)


@pytest.mark.parametrize(
    "count", [1, 2, 3, FEW_ROWS, FEW_ROWS + 1, CHUNK_ROWS - 1, CHUNK_ROWS, CHUNK_ROWS + 1, 2 * CHUNK_ROWS + 3]
)
@pytest.mark.parametrize("weighted", [False, True])
def test_chunks_do_not_show(count, weighted):
    rng = np.random.default_rng(count)
    p, q, m, n = (rng.normal(size=(count, 3)) for _ in range(4))
    beta, alpha = (rng.uniform(0, 2, count) for _ in range(2)) if weighted else (None, None)
    # A turn of 0.3 rad about z and a shift.
    T = np.eye(4)
    T[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    T[:3, 3] = [1, 2, 3]
    b, a = (np.ones(count), np.ones(count)) if not weighted else (beta, alpha)
    expected = (
        b @ ((p @ T[:3, :3].T + T[:3, 3] - q) ** 2).sum(axis=1),
        a @ ((m @ T[:3, :3].T - n) ** 2).sum(axis=1),
    )
    assert cost_of_pose(T, read_matches(p, q, m, n, beta, alpha)) == pytest.approx(expected, rel=1e-12)
