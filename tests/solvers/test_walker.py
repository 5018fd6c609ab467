from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.rigid import pose
from dqreg.rigid.quaternion import left_matrix, right_matrix
from dqreg.solvers import solve, walker1991
from dqreg.solvers.walker import Q, W
from tests.solvers.problems import TETRAHEDRON, assert_same_pose, euclidean_cost, fast, problems
from tests.strategies import quaternions

LAST = [1, 2, 3, 0]  # scalar first to the paper's order
near = st.booleans().flatmap(lambda directions: problems(directions=directions, far=False))


def position(p):
    return np.append(0.5 * p, 0.0)  # (26)


def direction(n):
    return np.append(n, 0.0)  # (27)


def paper_matrices(problem):
    """C1, C2, C3 and the constant as plain sums, one match after the other, from the matrices of another room."""
    p, q, m, n, beta, alpha = problem.args

    def QM(a):
        return left_matrix(a[[3, 0, 1, 2]])[np.ix_(LAST, LAST)]

    def WM(a):
        return right_matrix(a[[3, 0, 1, 2]])[np.ix_(LAST, LAST)]

    C1, C2, C3, constant = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 4)), 0.0
    for p0, p1, b in zip(map(position, p), map(position, q), beta, strict=True):
        C1 -= 2 * b * QM(p1).T @ WM(p0)
        C2 += b * np.eye(4)
        C3 += 2 * b * (WM(p0) - QM(p1))
        constant += b * (p0 @ p0 + p1 @ p1)
    if m is not None:
        for n0, n1, a in zip(map(direction, m), map(direction, n), alpha, strict=True):
            C1 -= 2 * a * QM(n1).T @ WM(n0)
            constant += 2 * a
    return C1, C2, C3, constant


@fast
@given(quaternions())
def test_15_16_matrices_are_those_of_the_products(a):
    # Walker eqs. 15, 16.
    first = a[[3, 0, 1, 2]]
    np.testing.assert_array_equal(Q(a), left_matrix(first)[np.ix_(LAST, LAST)])
    np.testing.assert_array_equal(W(a), right_matrix(first)[np.ix_(LAST, LAST)])


@fast
@given(near)
def test_beta_weighs_a_quarter_of_the_squared_distance(problem):
    # Walker eq. 26.
    p, q, m, n, beta, alpha = problem.args
    paper, ours = walker1991(*problem.args), solve(p, q, m, n, beta / 4, alpha)
    assert_same_pose(paper.T_target_source, ours.T_target_source)
    assert paper.cost == pytest.approx(ours.cost, rel=1e-12, abs=1e-14 * paper.constant)
    assert paper.rms == pytest.approx(ours.rms, rel=1e-10, abs=1e-12)
    assert paper.eigenvalue_gap == pytest.approx(ours.eigenvalue_gap, rel=1e-10)


def test_with_directions_the_quarter_matters():
    p = TETRAHEDRON
    q = p + np.array([[0.3, 0, 0], [0, 0, 0.2], [0, -0.1, 0], [0, 0, 0]])
    m, n = np.eye(3), np.array([[1.0, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]])
    paper = walker1991(p, q, m, n, 1.0, 1.0).T_target_source
    assert_same_pose(paper, solve(p, q, m, n, 0.25, 1.0).T_target_source)
    assert np.abs(paper - solve(p, q, m, n, 1.0, 1.0).T_target_source).max() > 0.01


@fast
@given(near)
def test_50_cost_is_the_constant_less_the_largest_eigenvalue(problem):
    # Walker eqs. 31 and 50.
    fit = walker1991(*problem.args)
    assert fit.cost == pytest.approx(fit.constant - fit.lambda_1, abs=1e-10 * fit.constant)
    problem.beta = problem.beta / 4
    assert fit.cost == pytest.approx(euclidean_cost(fit.T_target_source, problem), rel=1e-9, abs=1e-20)  # (31)


@fast
@given(near)
def test_28_29_30_the_dual_quaternion_moves_points_and_directions(problem):
    # Walker eqs. 27 to 30.
    fit = walker1991(*problem.args)
    rotation = W(fit.r).T @ Q(fit.r)
    p, m = problem.points[0][0], problem.points[0][1] / np.linalg.norm(problem.points[0][1])
    np.testing.assert_allclose(
        W(fit.r).T @ fit.s + rotation @ position(p), position(pose.apply(fit.T_target_source, p)), rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(
        rotation @ direction(m), direction(pose.rotate(fit.T_target_source, m)), rtol=0, atol=1e-13
    )


@fast
@given(problems(far=False))
def test_32_33_squared_differences_are_quadratic_forms(problem):
    # Walker eqs. 32, 33.
    fit = walker1991(*problem.args)
    r, s, T = fit.r, fit.s, fit.T_target_source
    n0, n1 = direction(problem.directions[0][0]), direction(problem.directions[1][0])
    gap = T[:3, :3] @ n0[:3] - n1[:3]
    assert gap @ gap == pytest.approx(2 * (1 - r @ Q(n1).T @ W(n0) @ r), abs=1e-13)  # (32)
    p0, p1 = position(problem.points[0][0]), position(problem.points[1][0])
    gap = position(pose.apply(T, problem.points[0][0])) - p1
    form = s @ s + 2 * s @ (W(p0) - Q(p1)) @ r - 2 * r @ Q(p1).T @ W(p0) @ r + p0 @ p0 + p1 @ p1
    assert gap @ gap == pytest.approx(form, abs=1e-11)  # (33)


@fast
@given(near)
def test_34_to_38_the_error_is_one_quadratic_form(problem):
    # Walker eqs. 34 to 38.
    C1, C2, C3, constant = paper_matrices(problem)
    fit = walker1991(*problem.args)
    r, s = fit.r, fit.s
    assert r @ C1 @ r + s @ C2 @ s + s @ C3 @ r + constant == pytest.approx(fit.cost, abs=1e-11 * constant)  # (34)
    assert fit.constant == pytest.approx(constant, rel=1e-13)  # (38)


@fast
@given(near)
def test_39_to_49_the_answer_meets_the_conditions_of_the_minimum(problem):
    # Walker eqs. 39 to 49.
    C1, C2, C3, constant = paper_matrices(problem)
    fit = walker1991(*problem.args)
    r, s, lambda_1 = fit.r, fit.s, fit.lambda_1
    tolerance = {"rtol": 0, "atol": 1e-12 * constant}
    assert r @ r == pytest.approx(1.0, abs=1e-14)  # (39)
    assert s @ r == pytest.approx(0.0, abs=1e-12)  # (40)
    np.testing.assert_allclose((C1 + C1.T) @ r + C3.T @ s + 2 * lambda_1 * r, np.zeros(4), **tolerance)  # (41)
    np.testing.assert_allclose((C2 + C2.T) @ s + C3 @ r, np.zeros(4), **tolerance)  # (42), (45)
    np.testing.assert_allclose(C3, -C3.T, **tolerance)  # skew, so lambda_2 = 0: (43), (44)
    A = 0.5 * (C3.T @ np.linalg.inv(C2 + C2.T) @ C3 - C1 - C1.T)  # (47)
    np.testing.assert_allclose(A @ r, lambda_1 * r, **tolerance)  # (46)
    assert lambda_1 == pytest.approx(np.linalg.eigvalsh(A)[-1], rel=1e-12)
    assert r @ C1 @ r == pytest.approx(-0.5 * s @ C3 @ r - lambda_1, abs=1e-12 * constant)  # (48)
    assert s @ C2 @ s == pytest.approx(-0.5 * s @ C3 @ r, abs=1e-12 * constant)  # (49)
