from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost, solve
from dqreg.solvers.minimise import rotation_grid, starts
from dqreg.solvers.newton import descend
from tests.solvers.cost_cases import frames, mixed, unit
from tests.solvers.free_chart import FreeChart
from tests.solvers.problems import fast

UP = np.array([0.0, 0.0, 1.0])


@fast
@given(st.integers(0, 1000), st.sampled_from([0.0, 1e-7, 0.5, 1.6, 1.87, 2.5, np.pi - 1e-7, np.pi]))
def test_exact_features_give_the_exact_pose_at_any_turn(seed: int, angle_rad: float) -> None:
    case = mixed(seed, angle_rad, noise=0.0)
    fit = case.cost.minimise()
    # The pose by construction, and Newton's method ends at rounding.
    np.testing.assert_allclose(fit.T_target_source, case.truth, atol=1e-11)
    assert fit.status == "converged"
    assert fit.cost <= 1e-14 * case.cost.form.scale
    np.testing.assert_allclose(fit.dual_quaternion.as_matrix(), fit.T_target_source, atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_mixed_features_end_where_scipy_ends(seed: int) -> None:
    from scipy.optimize import least_squares

    case = mixed(seed, noise=0.3)
    fit = case.cost.minimise()
    start = frames(seed + 50)
    ends = [
        least_squares(lambda x, T=T: case.residuals(pose.exp(x) @ T), np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        for T in (fit.T_target_source @ pose.exp([0.2, -0.1, 0.3, 0.1, 0.2, 0.1]), case.truth, start)
    ]
    lowest = min(2.0 * end.cost for end in ends)
    assert fit.cost == pytest.approx(lowest, rel=1e-12)
    # The first start is near, and its minimum the same one; SciPy's own stopping rule leaves 1e-8.
    near = pose.exp(ends[0].x) @ fit.T_target_source @ pose.exp([0.2, -0.1, 0.3, 0.1, 0.2, 0.1])
    np.testing.assert_allclose(fit.T_target_source, near, atol=1e-7)


@pytest.mark.parametrize("kind", ["planes", "lines"])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, 6))])
def test_no_random_start_ends_lower(kind: str, seed: int) -> None:
    # Few features and much noise: several minima.
    rng = np.random.default_rng(seed)
    n = 8 if kind == "planes" else 5
    p, axes = rng.normal(size=(n, 3)), unit(rng.normal(size=(n, 3)))
    q = pose.apply(frames(seed), p) + 0.2 * rng.normal(size=(n, 3))
    cost = getattr(PoseCost, kind)(p, q, axes)
    fit, form = cost.minimise(), cost.form
    values = [descend(form, FreeChart(T, form.origin_target)).value for T in pose.random(rng, reach=2.0, shape=(40,))]
    assert fit.cost <= min(values) + 1e-12 * form.scale
    assert fit.starts > 1


def test_a_hundred_thousand_planes_at_107_degrees() -> None:
    # Truth by construction; sigma 0.01 on each plane, so the pose is off by some 0.01 / sqrt(1e5) = 3e-5.
    rng = np.random.default_rng(0)
    n = 100_000
    p, normals = rng.normal(size=(n, 3)), unit(rng.normal(size=(n, 3)))
    truth = pose.exp(np.r_[np.deg2rad(107.0) * np.array([0.6, -0.64, 0.48]), 0.3, -0.2, 0.5])
    q = pose.apply(truth, p) + np.cross(normals, rng.normal(size=(n, 3)))
    exact = PoseCost.planes(p, q, normals)
    for fit in (exact.minimise(), exact.minimise(near=np.eye(4))):
        np.testing.assert_allclose(fit.T_target_source, truth, atol=1e-12)
        assert fit.iterations <= 15
    noisy = PoseCost.planes(p, q + 0.01 * rng.normal(size=(n, 3)), normals, weights=1e4)
    fit = noisy.minimise()
    error = pose.log(fit.T_target_source @ pose.inverse(truth))
    # Normalised by the information it is chi squared with six degrees of freedom: 30 is passed once in 25,000.
    assert error @ noisy.information(truth) @ error < 30.0


def test_far_origins_cost_no_digits() -> None:
    far = np.array([5e5, 4.4e6, 100.0])
    near, remote = mixed(4), mixed(4, far=1e6)
    a, b = near.cost.minimise(), remote.cost.minimise()
    shift = 1e6 * np.array([0.5, 4.4, -0.1])
    # One unit in the last place of 4.4e6 is 9e-10; the features differ by as much.
    assert pose.angle_between(a.T_target_source, b.T_target_source) < 1e-9
    assert pose.offset_between(pose.about(a.T_target_source, shift), b.T_target_source, at=shift) < 1e-8
    # A direction has no place: added first, it must not draw the origin to zero.
    p = np.random.default_rng(1).normal(size=(30, 3))
    q = pose.apply(near.truth, p)
    first = PoseCost.directions([[1, 0, 0]], [near.truth[:3, 0]])
    cost = first + PoseCost.points(p + far, q + far)
    fit = cost.minimise(near=pose.about(near.truth @ pose.exp([0.01, 0, 0, 0.1, 0, 0]), far))
    np.testing.assert_allclose(pose.apply(fit.T_target_source, p + far) - far, q, atol=1e-8)
    assert fit.cost < 1e-14 * 30 * 3
    # The sum keeps an origin by its points, whatever comes first, and by the stiffer of two.
    for whole in (cost, PoseCost.points(p, q, weights=1e-9) + cost):
        assert np.abs(whole.form.origin_target - far).max() < 10.0


@fast
@given(st.integers(0, 1000))
def test_near_the_answer_and_from_nowhere_the_minimum_is_one(seed: int) -> None:
    case = mixed(seed)
    fit = case.cost.minimise()
    again = case.cost.minimise(near=fit.T_target_source @ pose.exp([0.05, 0.02, -0.05, 0.1, 0.0, 0.1]))
    np.testing.assert_allclose(again.T_target_source, fit.T_target_source, atol=1e-11)
    scale = np.abs(case.cost.hessian(fit.T_target_source)).max()
    assert np.abs(case.cost.gradient(fit.T_target_source)).max() <= 1e-12 * scale
    assert np.linalg.eigvalsh(case.cost.hessian(fit.T_target_source))[0] > 0.0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_start_on_the_ridge_comes_down(axis: int) -> None:
    # Half a turn from the answer every slope is zero: by symmetry, that is a saddle or a top.
    corners = np.array(np.meshgrid([-1.0, 1.0], [-2.0, 2.0], [-3.0, 3.0])).reshape(3, -1).T
    top = pose.exp(np.r_[np.pi * np.eye(3)[axis], 0, 0, 0])
    cost = PoseCost.points(corners, corners)
    assert np.abs(cost.gradient(top)).max() < 1e-12
    np.testing.assert_allclose(cost.minimise(near=top).T_target_source, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("seed", [0, 2, 4, 13])
def test_newton_goes_down_into_the_valley_it_starts_in(seed: int) -> None:
    # One angle and two valleys each: walked down in steps of half a degree, and by Newton from where the curvature is
    # of any sign and size.
    rng = np.random.default_rng(seed)
    p, normals, q = rng.normal(size=(3, 6, 3))
    cost = PoseCost.planes(p, q, normals)
    angles = np.linspace(-np.pi, np.pi, 721)[:-1]
    heights = np.array([cost.value(pose.exp([0, 0, a, 0, 0, 0])) for a in angles])

    def bottom(i: int) -> int:
        j = min((i - 1, i, (i + 1) % 720), key=lambda k: heights[k])
        return i if j == i else bottom(j % 720)

    ends = {bottom(i) for i in range(0, 720, 30)}
    assert len(ends) == 2
    for i in range(0, 720, 30):
        T = cost.minimise(near=pose.exp([0, 0, angles[i], 0, 0, 0]), dof="rz").T_target_source
        expected = pose.exp([0, 0, angles[bottom(i)], 0, 0, 0])
        assert pose.angle_between(T, expected) < np.deg2rad(0.5)


def cylinder() -> PoseCost:
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 6, 200)
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    p = ring + UP * rng.uniform(-1, 1, (200, 1))
    return PoseCost.planes(p, p, ring)


FLAT_PART = np.column_stack([np.random.default_rng(2).uniform(-1, 1, (50, 2)), np.zeros(50)])
DEGENERATE = {
    "nothing": (PoseCost.points(np.zeros((0, 3)), np.zeros((0, 3))), 6, ["rotation", "translation"]),
    "one place": (PoseCost.points([[1.0, 2, 3]], [[1, 2, 3]]), 3, ["rotation about the axis through (1, 2, 3)"]),
    "a line": (PoseCost.points(np.outer([0, 1, 3], UP), np.outer([0, 1, 3], UP)), 1, ["along (0.00, 0.00, 1.00)"]),
    "a plane": (
        PoseCost.planes(FLAT_PART, FLAT_PART, np.tile(UP, (50, 1))),
        3,
        ["rotation", "along (0.00, 0.00, 1.00)", "translation"],
    ),
    # Its turn is felt in the fourth power of the angle, so it may count as free or not.
    "a cylinder": (cylinder(), None, ["translation along (0.00, 0.00, 1.00)"]),
    "directions": (PoseCost.directions(np.eye(3), np.eye(3)), 3, ["translation along"]),
    "all to one place": (PoseCost.points(np.vstack([np.eye(3), -np.eye(3)]), np.zeros((6, 3))), 3, ["rotation"]),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_free_motions_are_named(name: str) -> None:
    cost, count, words = DEGENERATE[name]
    with pytest.raises(DegenerateGeometryError) as error:
        cost.minimise()
    message = str(error.value)
    assert count in (message.count("rotation about") + message.count("translation along"), None)
    assert all(word in message for word in words)


@pytest.mark.parametrize("name", [name for name, case in DEGENERATE.items() if case[1]])
@pytest.mark.parametrize("seed", [1, 2])
def test_free_motions_stay_where_a_pose_is_given(name: str, seed: int) -> None:
    cost, count, _ = DEGENERATE[name]
    near = pose.exp(0.1 * pose.log(frames(seed)))
    fit = cost.minimise(near=near)
    assert len(fit.free) == count
    # The step away from the pose has no part along what is free, to second order in its size.
    centre = cost.form.origin_target
    B = np.linalg.svd(cost.hessian(fit.T_target_source, centre))
    free = B[2][B[1] <= 1e-9 * max(B[1][0], 1.0)]
    step = pose.log(pose.about(fit.T_target_source @ pose.inverse(near), -centre))
    assert np.abs(free @ step).max(initial=0.0) <= 2.0 * np.linalg.norm(step) ** 2 + 1e-12
    if name == "nothing":
        np.testing.assert_allclose(fit.T_target_source, near, atol=1e-15)


def test_what_is_hardly_felt_is_still_solved() -> None:
    # A strip 1e-5 as wide as long: the turn about it is felt by 1e-10 of the largest curvature, so that rounding of
    # 1e-16 in sums of squares moves it by some 1e-6; and `solve`, which forms the same squares, answers as well.
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (40, 3)) * [1, 1e-5, 0]
    truth = frames(3)
    q = pose.apply(truth, p)
    for fit in (PoseCost.points(p, q).minimise(), solve(p, q)):
        np.testing.assert_allclose(fit.T_target_source, truth, atol=2e-5)
        np.testing.assert_allclose(pose.apply(fit.T_target_source, p), q, atol=1e-9)


@pytest.mark.parametrize("words", ["rz", "rx ry", "r", "rz tx", "rx ry tz", "rz tx ty", "all", "t"])
def test_starts_come_in_the_order_of_their_costs_each_with_its_best_shift(words: str) -> None:
    form = mixed(1, noise=0.2).cost.form
    charts, closed = starts(form, Freedom.only(*words.split(), frame=frames(2)), frames(3))
    assert not closed
    values = [form.value(chart.pose) for chart in charts]
    # The closed form of the linear part stands beside the grid, at its place in the order.
    assert values == sorted(values)
    for chart in charts:
        gradient, hessian, _ = chart.slopes(form)
        assert np.abs(gradient[chart.turns :]).max(initial=0.0) <= 1e-11 * np.abs(hessian).max()


@pytest.mark.parametrize(
    ("turns", "farthest_deg"),
    [((False, True, False), 2.0), ((True, False, True), 12.0), ((True, True, True), 25.0)],
)
def test_no_turn_is_far_from_the_grid(turns: tuple[bool, bool, bool], farthest_deg: float) -> None:
    grid = rotation_grid(turns)
    np.testing.assert_allclose(np.linalg.norm(grid, axis=1), 1.0, atol=1e-14)
    assert not grid[:, 1:][:, ~np.array(turns)].any()
    drawn = np.random.default_rng(0).normal(size=(2_000, 4)) * (1.0, *turns)
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    nearest = np.abs(drawn @ grid.T).max(axis=1)
    assert np.rad2deg(2.0 * np.arccos(nearest.clip(max=1.0))).max() <= farthest_deg
    np.testing.assert_allclose(grid[0], [1, 0, 0, 0], atol=1e-15)
