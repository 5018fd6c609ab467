from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.solvers import solve, solve_many
from dqreg.solvers.batched_solver import BLOCK_NUMBERS
from tests.solvers.problems import TETRAHEDRON, assert_same_pose, fast, problems
from tests.solvers.test_refusals import DEGENERATE, ENOUGH

LINE = np.outer([0.0, 1, 2, 5], [1.0, 2, -2])


def assert_same_as_one_by_one(fits, each) -> None:
    """Every problem equals `solve` of it alone; what raises there is masked here."""
    for i, arguments in enumerate(each):
        try:
            fit = solve(*arguments)
        except DegenerateGeometryError:
            assert fits.degenerate[i]
            assert np.isnan(fits.T_target_source[i]).all()
            assert np.isnan(fits.cost[i])
            assert np.isnan(fits.rms[i])
            continue
        assert not fits.degenerate[i]
        assert_same_pose(fits.T_target_source[i], fit.T_target_source, 1e-12)
        assert fits.cost[i] == pytest.approx(fit.cost, rel=1e-8, abs=1e-18)
        assert fits.rms[i] == pytest.approx(fit.rms, rel=1e-8, abs=1e-9)
        assert fits.eigenvalue_gap[i] == pytest.approx(fit.eigenvalue_gap, rel=1e-12)


def stack(each, column):
    return np.concatenate([np.reshape(arguments[column], (-1, 3)) for arguments in each])


@fast
@given(st.lists(problems(far=False), min_size=1, max_size=5))
def test_different_sizes_equal_one_by_one(drawn):
    each = [problem.args for problem in drawn]
    edges = [np.cumsum([0] + [len(a[i]) for a in each]) for i in (0, 2)]
    weights = [np.concatenate([a[i] for a in each]) for i in (4, 5)]
    fits = solve_many(*(stack(each, i) for i in range(4)), *weights, offsets=edges[0], direction_offsets=edges[1])
    assert_same_as_one_by_one(fits, each)


@pytest.mark.parametrize("count", [1, 2, BLOCK_NUMBERS // 6, BLOCK_NUMBERS // 6 + 1])
@pytest.mark.parametrize("directions", [False, True])
@pytest.mark.parametrize("weighted", [False, True])
def test_equal_sizes_equal_one_by_one(count, directions, weighted):
    rng = np.random.default_rng(count)
    p, m = rng.normal(size=(count, 6, 3)), rng.normal(size=(count, 2, 3))
    q, n = p + 0.3 * rng.normal(size=p.shape), m + 0.3 * rng.normal(size=m.shape)
    beta, alpha = rng.uniform(0.1, 1, (count, 6)), rng.uniform(0.1, 1, (count, 2))
    p[count // 2] = np.arange(6)[:, None] * [1.0, 2, 3]
    arguments = (p, q, *((m, n) if directions else (None, None)), *((beta,) if weighted else (None,)))
    arguments += (alpha,) if weighted and directions else (None,)
    fits = solve_many(*arguments)
    some = [0, count // 2, count - 1]
    each = [tuple(None if a is None else a[i] for a in arguments) for i in some]
    assert not np.delete(fits.degenerate, count // 2).any()
    for row, one in zip(some, each, strict=True):
        alone = solve_many(*(None if a is None else np.asarray(a)[None] for a in one))
        assert_same_as_one_by_one(alone, [one])
        np.testing.assert_allclose(fits.T_target_source[row], alone.T_target_source[0], rtol=0, atol=1e-12)


def test_a_degenerate_problem_is_masked_and_disturbs_no_other():
    fits = solve_many([TETRAHEDRON, LINE, TETRAHEDRON], [TETRAHEDRON + 1, LINE, TETRAHEDRON + 2])
    assert fits.degenerate.tolist() == [False, True, False]
    assert np.isnan(fits.T_target_source[1]).all()
    assert np.isnan(fits.cost[1])
    assert np.isnan(fits.rms[1])
    assert fits.eigenvalue_gap[1] < 1e-15
    np.testing.assert_allclose(fits.T_target_source[[0, 2], :3, 3], [[1.0] * 3, [2.0] * 3], rtol=0, atol=1e-14)


@pytest.mark.parametrize("case", DEGENERATE)
def test_what_solve_refuses_is_masked(case):
    p, q, *rest = DEGENERATE[case]
    p, q = np.atleast_2d(p), np.atleast_2d(q)
    m, n = (np.reshape(rest[i] if len(rest) > 1 and rest[i] is not None else np.zeros((0, 3)), (-1, 3)) for i in (0, 1))
    beta = np.broadcast_to(rest[2] if len(rest) > 2 else 1.0, len(p))
    alone = solve_many(p, q, m, n, beta, offsets=[0, len(p)], direction_offsets=[0, len(m)])
    assert alone.degenerate.all()
    beside = solve_many(
        *(np.vstack([side, TETRAHEDRON]) for side in (p, q)),
        m,
        n,
        np.concatenate([beta, np.ones(4)]),
        offsets=[0, len(p), len(p) + 4],
        direction_offsets=[0, len(m), len(m)],
    )
    assert beside.degenerate.tolist() == [True, False]
    np.testing.assert_allclose(beside.T_target_source[1], np.eye(4), rtol=0, atol=1e-14)


@pytest.mark.parametrize("case", ENOUGH)
def test_what_solve_accepts_is_solved(case):
    p, *rest = ENOUGH[case]
    directions = (np.array(rest[0])[None],) * 2 if rest else ()
    fits = solve_many(p[None], p[None], *directions)
    np.testing.assert_allclose(fits.T_target_source[0, :3, :3], np.eye(3), rtol=0, atol=1e-11)


def test_sizes_far_apart_go_together():
    rng = np.random.default_rng(2)
    sizes = [3, 0, 20_000, 4, 5, 1, 700]
    rows = rng.normal(size=(sum(sizes), 3))
    moved = rows[:, [1, 2, 0]] + [1, 2, 3]
    fits = solve_many(rows, moved, offsets=np.cumsum([0, *sizes]))
    assert fits.degenerate.tolist() == [size < 3 for size in sizes]
    good = fits.T_target_source[~fits.degenerate]
    expected = np.array([[0.0, 1, 0, 1], [0, 0, 1, 2], [1, 0, 0, 3], [0, 0, 0, 1]])
    np.testing.assert_allclose(good, np.broadcast_to(expected, good.shape), rtol=0, atol=1e-12)


@pytest.mark.parametrize("origin", [1e6, 5e6])
@pytest.mark.parametrize("size", [6, 2000])
def test_a_far_origin_loses_nothing_but_the_rounding_of_the_coordinates(origin, size):
    # Binary fractions stay exact far away, so the joined means show what the sums lost.
    p = np.round(np.random.default_rng(1).uniform(-1, 1, (3, size, 3)) * 2**20) / 2**20 + origin
    fits = solve_many(p, np.add(p, [1.0, 2, 3]))
    np.testing.assert_allclose(fits.T_target_source[:, :3, :3], np.stack([np.eye(3)] * 3), rtol=0, atol=1e-14)
    mapped = np.einsum("bij,bnj->bni", fits.T_target_source[:, :3, :3], p) + fits.T_target_source[:, None, :3, 3]
    np.testing.assert_allclose(mapped, np.add(p, [1.0, 2, 3]), rtol=0, atol=4e-9)
    assert (fits.rms < 2e-9).all()


def test_no_problems_are_no_fits():
    fits = solve_many(np.zeros((0, 6, 3)), np.zeros((0, 6, 3)))
    assert fits.T_target_source.shape == (0, 4, 4)
    assert fits.degenerate.shape == (0,)


P = np.stack([TETRAHEDRON, TETRAHEDRON])
F = P.reshape(-1, 3)
BAD = {
    "NaN": ({"points_source": P * float("nan"), "points_target": P}, "NaN"),
    "shapes": ({"points_source": P, "points_target": P[:, :3]}, "give the same"),
    "flat without offsets": ({"points_source": F, "points_target": F}, "with offsets"),
    "stack with offsets": ({"points_source": P, "points_target": P, "offsets": [0, 4, 8]}, r"\(total, 3\)"),
    "short offsets": ({"points_source": F, "points_target": F, "offsets": [0, 4]}, "number of rows, 8"),
    "falling offsets": ({"points_source": F, "points_target": F, "offsets": [0, 9, 8]}, "smallest step -1"),
    "broken offsets": ({"points_source": F, "points_target": F, "offsets": [0, 4.5, 8]}, "whole numbers"),
    "negative weight": ({"points_source": P, "points_target": P, "point_weights": -1.0}, "negative"),
    "weights' shape": ({"points_source": P, "points_target": P, "point_weights": np.ones(8)}, r"shape \(2, 4\)"),
    "one side": ({"points_source": P, "points_target": P, "directions_source": P}, "directions_target is missing"),
    "sets": (
        {"points_source": P, "points_target": P, "directions_source": P[:1], "directions_target": P[:1]},
        "2 problems and directions 1",
    ),
    "weights alone": ({"points_source": P, "points_target": P, "direction_weights": 1.0}, "without directions"),
    "zero direction": (
        {"points_source": P, "points_target": P, "directions_source": P, "directions_target": 0 * P},
        "directions_target holds 8 directions of length zero",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_named(case):
    arguments, words = BAD[case]
    with pytest.raises(InputError, match=words):
        solve_many(**arguments)


def test_even_problems_without_rows_are_degenerate_ones():
    fits = solve_many(np.zeros((3, 0, 3)), np.zeros((3, 0, 3)))
    assert fits.degenerate.all()
    assert np.isnan(fits.T_target_source).all()
    assert fits.T_target_source.shape == (3, 4, 4)
    both = solve_many(np.ones((3, 1, 3)), np.ones((3, 1, 3)), np.zeros((3, 0, 3)), np.zeros((3, 0, 3)))
    assert both.degenerate.all()
    assert solve_many(np.zeros((0, 5, 3)), np.zeros((0, 5, 3))).degenerate.shape == (0,)
