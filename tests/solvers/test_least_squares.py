from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from dqreg.rigid import pose, twist
from dqreg.solvers import cost_of_pose, horn, read_matches, solve, svd, walker1991
from tests.solvers.problems import TETRAHEDRON, Problem, assert_same_pose, euclidean_cost, fast, problems
from tests.strategies import floats, poses

EPS = float(np.finfo(np.float64).eps)
# Rotation by exact numbers, turns of pi / 2 about z; and a shift.
QUARTER = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def oracle_rotation(problem: Problem) -> np.ndarray:
    """SciPy's weighted alignment of the points about their means, the directions stacked below."""
    p, q, m, n, beta, alpha = problem.args
    beta = np.ones(len(p)) if beta is None else beta
    a, b = q - np.average(q, axis=0, weights=beta), p - np.average(p, axis=0, weights=beta)
    if m is not None:
        a, b = np.vstack([a, n]), np.vstack([b, m])
        beta = np.concatenate([beta, np.ones(len(m)) if alpha is None else alpha])
    return Rotation.align_vectors(a, b, weights=beta)[0].as_matrix()


@fast
@given(st.booleans().flatmap(lambda directions: problems(directions=directions, far=False)))
def test_rotation_equals_scipy_on_weighted_points_and_directions(problem):
    np.testing.assert_allclose(
        solve(*problem.args).T_target_source[:3, :3], oracle_rotation(problem), rtol=0, atol=1e-11
    )


@pytest.mark.parametrize("yardstick", [svd, horn])
@fast
@given(problem=st.booleans().flatmap(lambda directions: problems(directions=directions)))
def test_all_solvers_find_the_same_pose_cost_and_gap(yardstick, problem):
    ours, other = solve(*problem.args), yardstick(*problem.args)
    # Targets up to 1e6 away hold their own noise to 1e-10 only.
    assert_same_pose(ours.T_target_source, other.T_target_source, 1e-11)
    assert ours.cost == pytest.approx(other.cost, rel=1e-8, abs=1e-16)
    assert ours.rms == pytest.approx(other.rms, rel=1e-8, abs=1e-8)
    assert ours.eigenvalue_gap == pytest.approx(other.eigenvalue_gap, rel=1e-10)


@fast
@given(problems(noise=0.0))
def test_an_exact_fit_gives_the_true_pose_and_no_cost(problem):
    # Rounding of target coordinates up to 1e6 away is what an exact fit leaves.
    grain = 1e-15 * (10.0 + np.abs(problem.T[:3, 3]).max())
    fit = solve(*problem.args)
    assert_same_pose(fit.T_target_source, problem.T, max(1e-12, 100 * grain))
    assert 0.0 <= fit.cost <= 200 * (10 * grain) ** 2 + 1e-28
    assert fit.rms <= 10 * grain


@fast
@given(problems(), arrays(np.float64, 6, elements=floats(-1, 1)), st.sampled_from([1e-4, 1e-2, 1.0]))
def test_no_small_motion_lowers_the_cost(problem, direction, step):
    fit = solve(*problem.args)
    # About the target's mean, so that a turn does not sweep a far part away.
    moved = pose.about(twist.exp(step * direction), problem.points[1].mean(axis=0)) @ fit.T_target_source
    assert euclidean_cost(moved, problem) >= fit.cost * (1 - 1e-9) - 1e-12


@fast
@given(problems())
def test_the_cost_is_that_of_the_pose(problem):
    fit = solve(*problem.args)
    assert fit.cost == pytest.approx(euclidean_cost(fit.T_target_source, problem), rel=1e-8, abs=1e-16)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_a_small_cost_keeps_its_digits(noise):
    # +-noise along z on the corners of a square, alternating: no pose lowers it, the best one is the identity.
    p = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    q = p + noise * np.array([[0, 0, 1.0], [0, 0, -1], [0, 0, 1], [0, 0, -1]])
    fit = solve(p, q)
    assert fit.cost == pytest.approx(4 * noise**2, rel=1e-8)
    assert fit.rms == pytest.approx(noise, rel=1e-8)


@pytest.mark.parametrize("noise", [1e-1, 1e-3, 1e-5, 1e-9])
@pytest.mark.parametrize(("turned", "alpha"), [(0.0, 1.0), (0.5, 1.0), (0.0, 1e12)])
def test_a_cost_of_many_matches_keeps_its_digits(noise, turned, alpha):
    # Points noisy by `noise`. Directions exact; or half turned forward and half back, so that they make up the cost;
    # or exact and so heavy that the points' cost is lost beside them.
    rng = np.random.default_rng(8)
    p, m = rng.normal(size=(9001, 3)), np.tile(np.eye(3), (3000, 1))
    tilts = Rotation.from_rotvec(np.repeat([[0, 0, turned], [0, 0, -turned]], 4500, axis=0))
    q, n = pose.apply(QUARTER, p) + noise * rng.normal(size=p.shape), tilts.apply(pose.rotate(QUARTER, m))
    fit = solve(p, q, m, n, None, alpha)
    points, directions = cost_of_pose(fit.T_target_source, read_matches(p, q, m, n, None, alpha))
    assert fit.cost == pytest.approx(points + directions, rel=1e-7)
    assert fit.rms == pytest.approx(np.sqrt(points / len(p)), rel=1e-7)


@fast
@given(problems(weights=False), st.data())
def test_whole_weights_are_repetitions(problem, data):
    p, q, m, n, *_ = problem.args
    beta = np.array(data.draw(st.lists(st.integers(0, 3), min_size=len(p), max_size=len(p))))
    beta[:4] += 1
    alpha = np.array(data.draw(st.lists(st.integers(0, 3), min_size=len(m), max_size=len(m))))
    repeated = [np.repeat(rows, beta, axis=0) for rows in (p, q)] + [np.repeat(rows, alpha, axis=0) for rows in (m, n)]
    ours, other = solve(p, q, m, n, beta, alpha), solve(*repeated)
    assert_same_pose(ours.T_target_source, other.T_target_source, 1e-11)
    assert ours.rms == pytest.approx(other.rms, rel=1e-8, abs=1e-8)


@fast
@given(problems())
def test_forward_is_the_inverse_of_backward(problem):
    forward, back = solve(*problem.args), solve(*problem.back)
    reach = 10.0 + np.abs(problem.T[:3, 3]).max()
    np.testing.assert_allclose(
        back.T_target_source @ forward.T_target_source, np.eye(4), rtol=0, atol=1e-11 + 1e-12 * reach
    )
    assert forward.cost == pytest.approx(back.cost, rel=1e-8, abs=1e-16)


@fast
@given(problems(far=False), poses())
def test_a_moved_source_gives_the_composed_pose(problem, T_moved_source):
    p, q, m, n, *weights = problem.args
    turned = pose.rotate(T_moved_source, m)
    moved = solve(pose.apply(T_moved_source, p), q, turned, n, *weights)
    # The moved source, up to 1e6 away, holds the part to 1e-10 only.
    reach = 10.0 + np.abs(T_moved_source[:3, 3]).max()
    composed = moved.T_target_source @ T_moved_source
    np.testing.assert_allclose(
        composed, solve(*problem.args).T_target_source, rtol=0, atol=1e-14 * reach + 1e-12 + 1e-15 * reach * reach / 10
    )


@pytest.mark.parametrize("origin", [1e6, 5e6])
@pytest.mark.parametrize("count", [6, 5000])
@pytest.mark.parametrize("solver", [solve, svd, horn])
def test_a_far_origin_loses_nothing_but_the_rounding_of_the_coordinates(origin, count, solver):
    rng = np.random.default_rng(3)
    p = np.round(rng.uniform(-1, 1, (count, 3)) * 2**20) / 2**20
    # A quarter turn and a shift in binary fractions keep the far coordinates exact: what is lost, the solver lost.
    q = p @ QUARTER[:3, :3].T + QUARTER[:3, 3]
    fit = solver(p + origin, q + origin)
    # Rotation: an eigenvector of a 4x4 matrix holds 4^2 eps / gap, with a gap of about 4/3; the rotation doubles that.
    turn = 32 * EPS
    np.testing.assert_allclose(fit.T_target_source[:3, :3], QUARTER[:3, :3], rtol=0, atol=turn)
    # Images: rounding of two means of the size of the origin, of t and of R p, some twice as large, here and there.
    grain = 8 * EPS * origin
    images = pose.apply(fit.T_target_source, p + origin)
    np.testing.assert_allclose(images, q + origin, rtol=0, atol=grain)
    assert fit.rms < np.sqrt(3) * grain
    # The pose itself, written about the far origin: the rounding of R has a lever of three coordinates there.
    shift = np.eye(4)
    shift[:3, 3] = origin
    expected = shift @ QUARTER @ np.linalg.inv(shift)
    np.testing.assert_allclose(fit.T_target_source[:3, 3], expected[:3, 3], rtol=0, atol=3 * origin * turn + grain)


@fast
@given(problems(directions=False, far=False))
def test_scaling_both_clouds_scales_the_translation_only(problem):
    p, q, *_ = problem.args
    small, large = solve(p, q, point_weights=problem.beta), solve(1000 * p, 1000 * q, point_weights=problem.beta)
    T_small = small.T_target_source.copy()
    T_small[:3, 3] *= 1000
    assert_same_pose(large.T_target_source, T_small, 1e-11)
    assert large.rms == pytest.approx(1000 * small.rms, rel=1e-9, abs=1e-10)
    assert large.eigenvalue_gap == pytest.approx(small.eigenvalue_gap, rel=1e-10)


@fast
@given(problems(far=False), floats(0.2, 5.0), floats(0.2, 5.0))
def test_directions_are_weighed_as_given_not_scaled_to_unit_length(problem, a, b):
    p, q, m, n, beta, alpha = problem.args
    longer, weighted = solve(p, q, a * m, b * n, beta, alpha), solve(p, q, m, n, beta, a * b * alpha)
    assert_same_pose(longer.T_target_source, weighted.T_target_source, 1e-11)
    stretched = Problem(problem.T, (p, q), (a * m, b * n), beta, alpha)
    assert longer.cost == pytest.approx(euclidean_cost(longer.T_target_source, stretched), rel=1e-9)


def test_zero_weight_rejects_a_match():
    q = TETRAHEDRON @ QUARTER[:3, :3].T + QUARTER[:3, 3]
    p_wild, q_wild = np.vstack([TETRAHEDRON, [1e9, 0, 0]]), np.vstack([q, [0, 0, -1e9]])
    fit = solve(p_wild, q_wild, [[0, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 1]], [1, 1, 1, 1, 0], [0, 1])
    assert_same_pose(fit.T_target_source, QUARTER)
    assert fit.cost < 1e-25


def test_a_mirrored_target_gives_a_rotation():
    p = np.vstack([TETRAHEDRON, [3.0, 1, 1]])
    for solver in (solve, svd, horn, walker1991):
        R = solver(p, p * [1, 1, -1]).T_target_source[:3, :3]
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)


def test_the_arguments_are_left_alone():
    rng = np.random.default_rng(5)
    arguments = [rng.uniform(1, 2, (5000, 3)) for _ in range(4)] + [rng.uniform(1, 2, 5000) for _ in range(2)]
    copies = [array.copy() for array in arguments]
    solve(*arguments)
    for array, copy in zip(arguments, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


@fast
@given(problems(far=False))
def test_the_dual_quaternion_is_the_pose(problem):
    fit = solve(*problem.args)
    np.testing.assert_allclose(fit.dual_quaternion.as_matrix(), fit.T_target_source, rtol=0, atol=1e-13)
    assert fit.dual_quaternion is fit.dual_quaternion
