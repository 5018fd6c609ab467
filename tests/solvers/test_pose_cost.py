from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.solvers import PoseCost, moments_of, solve, solve_moments
from dqreg.solvers.pose_cost_rows import SLICE_ROWS
from tests.solvers.cost_cases import frames, mixed, numeric_slopes
from tests.solvers.problems import Problem, fast, problems
from tests.strategies import poses

SEEDS = st.integers(0, 1000)


@fast
@given(SEEDS, SEEDS)
def test_the_cost_is_the_sum_of_the_squares_written_out(seed: int, other: int) -> None:
    case, T = mixed(seed), frames(other)
    assert case.cost.value(T) == pytest.approx(np.sum(case.residuals(T) ** 2), rel=1e-12)


@fast
@given(SEEDS, st.permutations(range(4)), poses())
def test_costs_add_up_in_any_order(seed: int, order: list[int], T: np.ndarray) -> None:
    case = mixed(seed)
    parts = [case.parts[i] for i in order]
    total = sum(part.value(T) for part in parts)
    left, right = sum(parts[1:], start=parts[0]), parts[0] + (parts[1] + (parts[2] + parts[3]))
    for whole in (left, right, sum(parts)):
        assert whole.value(T) == pytest.approx(total, rel=1e-12)
    np.testing.assert_allclose(
        left.minimise(near=case.truth).T_target_source, right.minimise(near=case.truth).T_target_source, atol=1e-12
    )


@fast
@given(SEEDS, st.floats(0.0, 1e3), st.floats(0.0, 1e3))
def test_factors_are_weights(seed: int, a: float, b: float) -> None:
    case, T = mixed(seed), frames(seed)
    one, other = case.parts[1], case.parts[2]
    assert (a * one + other * b).value(T) == pytest.approx(a * one.value(T) + b * other.value(T), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("frame", [None, [0.3, -2.0, 1.0], frames(3)], ids=["target", "point", "frame"])
@pytest.mark.parametrize("at", ["truth", "identity", "elsewhere"])
def test_derivatives_agree_with_finite_differences(frame: object, at: str) -> None:
    case = mixed(1)
    T = {"truth": case.truth, "identity": np.eye(4), "elsewhere": frames(9)}[at]
    F = np.eye(4) if frame is None else frame if np.ndim(frame) == 2 else pose.from_parts(np.eye(3), frame)

    def value(x: np.ndarray) -> float:
        return float(np.sum(case.residuals(F @ pose.exp(x) @ pose.inverse(F) @ T) ** 2))

    # Fourth order with steps of 1e-3: truncation 1e-12, rounding 1e-16 / 1e-3; second order for the Hessian: 1e-6.
    gradient, hessian = numeric_slopes(value, 1e-3)
    size = np.abs(hessian).max()
    np.testing.assert_allclose(case.cost.gradient(T, frame), gradient, atol=1e-9 * size)
    np.testing.assert_allclose(case.cost.hessian(T, frame), hessian, atol=1e-5 * size)


@pytest.mark.parametrize("frame", [None, frames(3)], ids=["target", "frame"])
def test_the_information_is_that_of_the_residuals(frame: np.ndarray | None) -> None:
    case, T = mixed(2), frames(5)
    F = np.eye(4) if frame is None else frame
    h = 1e-5
    J = np.array(
        [
            (
                case.residuals(F @ pose.exp(d) @ pose.inverse(F) @ T)
                - case.residuals(F @ pose.exp(-d) @ pose.inverse(F) @ T)
            )
            for d in h * np.eye(6)
        ]
    ).T / (2 * h)
    information = case.cost.information(T, frame)
    np.testing.assert_allclose(information, J.T @ J, atol=1e-8 * np.abs(information).max())
    parts = sum(part.information(T, frame) for part in case.parts)
    np.testing.assert_allclose(information, parts, atol=1e-12 * np.abs(parts).max())


@fast
@given(SEEDS, poses(), poses())
def test_a_change_of_both_frames_changes_nothing(seed: int, S: np.ndarray, G: np.ndarray) -> None:
    # p' = S p, q' = G q, so the same cost stands at T' = G T S^-1. Coordinates of up to 1e6 round at 1e-10.
    case, T = mixed(seed), frames(seed + 1)
    p, q, axes = pose.apply(S, case.p), pose.apply(G, case.q), pose.rotate(G, case.axes)
    moved = (
        PoseCost.points(p[:3], q[:3], case.w[:3])
        + PoseCost.planes(p[3:16], q[3:16], axes[3:16], case.w[3:16])
        + PoseCost.lines(p[16:], q[16:], axes[16:], case.w[16:])
        + PoseCost.directions(pose.rotate(S, case.m), pose.rotate(G, case.n), case.w[:4])
    )
    T_moved = G @ T @ pose.inverse(S)
    tolerance = 1e-12 * (1.0 + np.abs([S[:3, 3], G[:3, 3], T_moved[:3, 3]]).max())
    assert moved.value(T_moved) == pytest.approx(case.cost.value(T), rel=10 * tolerance)
    # The slope by a twist of the new frame G is the slope by that of the old one.
    old = case.cost.gradient(T)
    np.testing.assert_allclose(moved.gradient(T_moved, G), old, atol=100 * tolerance * np.abs(old).max())


@fast
@given(SEEDS)
def test_recentred_costs_count_from_other_points(seed: int) -> None:
    case, T = mixed(seed, far=1e6), frames(seed)
    source, target = case.p[0], case.q[0]
    near = pose.from_parts(T[:3, :3], T[:3, 3] - target + T[:3, :3] @ source)
    assert case.cost.recentred(source, target).value(near) == pytest.approx(case.cost.value(T), rel=1e-9)


@fast
@given(problems(far=False))
def test_points_and_directions_are_solved_as_dqreg_solve_does(problem: Problem) -> None:
    p, q, m, n, beta, alpha = problem.args
    cost = PoseCost.points(p, q, beta)
    if m is not None:
        cost += PoseCost.directions(m, n, alpha)
    fit = cost.minimise()
    assert fit.status == "closed form"
    expected = solve(*problem.args)
    # How well the rotation is determined: rounding over the gap of the eigenvalues.
    np.testing.assert_allclose(fit.T_target_source, expected.T_target_source, atol=1e-12 / expected.eigenvalue_gap)
    assert fit.cost == pytest.approx(expected.cost, rel=1e-9, abs=1e-12 * cost.form.scale)


def test_moments_and_forms_hold_the_same_minimum_of_a_million_chunks_of_work() -> None:
    rng = np.random.default_rng(0)
    p = rng.normal(size=(3 * SLICE_ROWS // 2, 3))
    q = pose.apply(frames(1), p) + rng.normal(size=p.shape)
    expected = solve_moments(moments_of(p, q)).T_target_source
    np.testing.assert_allclose(PoseCost.points(p, q).minimise().T_target_source, expected, atol=1e-12)


@pytest.mark.parametrize("far", [0.0, 1e6])
def test_chunks_are_the_whole(far: float) -> None:
    # Several slices of a builder, and chunks of very unequal size and place. Coordinates of 4e6 round at 1e-9.
    rng = np.random.default_rng(4)
    n = 2 * SLICE_ROWS + 1001
    p, normals = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    p[:, 0].sort()
    T = frames(2)
    q = pose.apply(T, p) + 0.1 * rng.normal(size=p.shape) + far
    p = p + far
    w = rng.uniform(size=n)
    whole = PoseCost.planes(p, q, normals, w)
    bounds = [0, 1, 10, 5_000, 5_000, SLICE_ROWS, n]
    chunks = ((p[a:b], q[a:b], normals[a:b], w[a:b]) for a, b in itertools.pairwise(bounds))
    pieces = sum(PoseCost.planes(*chunk) for chunk in chunks)
    at = whole.minimise(near=pose.about(T, np.full(3, far))).T_target_source
    tolerance = 1e-12 if far == 0.0 else 1e-9
    assert pieces.value(at) == pytest.approx(whole.value(at), rel=tolerance)
    found = pieces.minimise(near=at).T_target_source
    place = np.full(3, far)
    assert pose.offset_between(found, at, at=place) <= tolerance
    assert pose.angle_between(found, at) <= tolerance


def test_arrays_on_disk_and_of_other_kinds_are_read_as_they_are(tmp_path) -> None:
    case = mixed(3)
    stored = np.lib.format.open_memmap(tmp_path / "p.npy", mode="w+", dtype=np.float32, shape=case.p.shape)
    stored[:] = case.p
    T = frames(0)
    expected = PoseCost.points(case.p.astype(np.float32).astype(float), case.q).value(T)
    assert PoseCost.points(np.load(tmp_path / "p.npy", mmap_mode="r"), case.q.tolist()).value(T) == expected


def test_nothing_is_no_cost() -> None:
    none = np.zeros((0, 3))
    case = mixed(0)
    empty = [PoseCost.points(none, none), PoseCost.planes(none, none, none), PoseCost.directions(none, none)]
    T = frames(0)
    assert [cost.value(T) for cost in empty] == [0.0] * 3
    assert (sum(empty) + case.cost).value(T) == pytest.approx(case.cost.value(T), rel=1e-14)
    # A row of weight zero may hold a normal that points nowhere.
    spoilt = PoseCost.planes([[1, 2, 3], [0, 0, 0]], [[0, 0, 0], [1, 1, 1]], [[0, 0, 0], [0, 3, 0]], [0, 1])
    assert spoilt.value(np.eye(4)) == pytest.approx(1.0, rel=1e-14)


ROWS = np.ones((4, 3))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: PoseCost.points(ROWS, ROWS[:3]), "p has 4 rows and q 3"),
        (lambda: PoseCost.points(ROWS[:, :2], ROWS), "p must have shape"),
        (lambda: PoseCost.points("no", ROWS), "p must be an array"),
        (lambda: PoseCost.points(ROWS * np.nan, ROWS), "p, rows from 0 holds 12 numbers that are NaN"),
        (lambda: PoseCost.points(ROWS, ROWS, [-1, 1, 1, 1]), "weights must not be negative"),
        (lambda: PoseCost.points(ROWS, ROWS, [1, 1]), "weights must be one number or 4"),
        (lambda: PoseCost.points(1e200 * np.eye(3), np.eye(3)), "larger unit"),
        (lambda: PoseCost.planes(ROWS, ROWS, 0 * ROWS), "normals holds 4 directions of length zero"),
        (lambda: PoseCost.lines(ROWS, ROWS, 0 * ROWS), "directions holds 4 directions of length zero"),
        (lambda: PoseCost.points(ROWS, ROWS) * -1.0, "0 or more"),
        (lambda: PoseCost.points(ROWS, ROWS).value(np.zeros((4, 4))), "T must have the last row"),
        (lambda: PoseCost.points(ROWS, ROWS).gradient(np.eye(4), frame=[1, 2]), "frame must be a 4x4 pose"),
        (lambda: PoseCost.points(ROWS, ROWS).minimise(dof="rz"), "reference= or near="),
        (lambda: PoseCost.points(ROWS, ROWS).minimise(near=np.eye(4), reference=np.eye(4)), "give dof= too"),
        (lambda: PoseCost.points(ROWS, ROWS).minimise(near=np.eye(4), dof="yaw"), "unknown motion 'yaw'"),
    ],
)
def test_bad_input_is_named(call, words: str) -> None:
    with pytest.raises(InputError) as error:
        call()
    assert words in str(error.value)


def test_only_costs_and_factors_combine() -> None:
    cost = PoseCost.points(ROWS, ROWS)
    for other in (3.0, "x", None):
        with pytest.raises(TypeError):
            cost + other
    with pytest.raises(TypeError):
        cost * cost
