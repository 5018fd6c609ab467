from __future__ import annotations

import numpy as np
import pytest

from dqreg.rigid import pose, twist
from dqreg.solvers import solve
from dqreg.solvers.newton import local_minimum
from dqreg.solvers.quadratic import QuadraticForm, derivatives, direction_form, line_form, plane_form, point_form

RNG = np.random.default_rng(5)
P, Q = RNG.normal(size=(2, 40, 3))
N, M = RNG.normal(size=(2, 40, 3)) / np.sqrt(3.0)
W = RNG.uniform(0.5, 2.0, 40)
T = pose.exp([1.5, -1.0, 0.7, 0.3, 0.2, -0.5])
ZERO = (np.zeros(3), np.zeros(3))


def form(matrix, origins=ZERO) -> QuadraticForm:
    return QuadraticForm(matrix, *origins)


def mixed(origins=ZERO) -> QuadraticForm:
    matrix = plane_form(P, Q, N, W, origins) + 0.3 * point_form(P, Q, W, origins) + direction_form(M, N, W)
    return form(matrix, origins)


def test_values_are_the_sums_written_out():
    x, d = pose.apply(T, P) - Q, pose.rotate(T, M) - N
    assert form(point_form(P, Q, W, ZERO)).value(T) == pytest.approx(W @ (x**2).sum(1), rel=1e-12)
    assert form(plane_form(P, Q, N, W, ZERO)).value(T) == pytest.approx(W @ (x * N).sum(1) ** 2, rel=1e-12)
    assert form(direction_form(M, N, W)).value(T) == pytest.approx(W @ (d**2).sum(1), rel=1e-12)


def test_a_line_is_a_point_without_the_plane_along_it():
    d = N / np.linalg.norm(N, axis=1, keepdims=True)
    x = pose.apply(T, P) - Q
    off = x - (x * d).sum(1)[:, None] * d
    assert form(line_form(P, Q, d, W, ZERO)).value(T) == pytest.approx(W @ (off**2).sum(1), rel=1e-12)


def test_parts_add_up_and_origins_do_not_matter():
    whole = mixed()
    origins = (RNG.normal(size=3), RNG.normal(size=3))
    halves = [
        QuadraticForm(plane_form(P[s], Q[s], N[s], W[s], o), *o)
        + QuadraticForm(0.3 * point_form(P[s], Q[s], W[s], o) + direction_form(M[s], N[s], W[s]), *o)
        for s, o in ((slice(0, 15), ZERO), (slice(15, 40), origins))
    ]
    assert (halves[0] + halves[1]).value(T) == pytest.approx(whole.value(T), rel=1e-12)
    assert mixed(origins).value(T) == pytest.approx(whole.value(T), rel=1e-12)


@pytest.mark.parametrize("origins", [ZERO, (np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.1, -0.7]))])
def test_derivatives_agree_with_finite_differences(origins):
    cost = mixed(origins)
    gradient, hessian, _ = derivatives(cost, T)

    def at(x):
        return pose.about(twist.exp(x), cost.origin_target) @ T

    h = 1e-5
    steps = h * np.eye(6)
    numeric = np.array([(cost.value(at(e)) - cost.value(at(-e))) / (2 * h) for e in steps])
    # Central differences of a cost of a few hundred: rounding eps * 300 / h and truncation h^2.
    np.testing.assert_allclose(gradient, numeric, atol=1e-6 * np.abs(gradient).max())
    h = 1e-3
    steps = h * np.eye(6)
    second = np.array(
        [
            [
                (cost.value(at(a + b)) - cost.value(at(a - b)) - cost.value(at(b - a)) + cost.value(at(-a - b)))
                / (4 * h * h)
                for b in steps
            ]
            for a in steps
        ]
    )
    np.testing.assert_allclose(hessian, second, atol=1e-4 * np.abs(hessian).max())
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12 * np.abs(hessian).max())


def test_points_and_directions_have_the_closed_form_as_their_minimum():
    cost = form(point_form(P, Q, W, ZERO) + direction_form(M, N, W))
    fit = solve(P, Q, M, N, W, W)
    reached = local_minimum(cost, fit.T_target_source @ pose.exp([0.1, -0.2, 0.1, 0.1, 0.0, 0.2]))
    np.testing.assert_allclose(reached, fit.T_target_source, atol=1e-9)


@pytest.mark.parametrize("angle", [0.1, 1.0, 1.9])
def test_planes_are_met_exactly_also_from_far(angle):
    # Truth by construction: every plane passes through the moved point. From the identity, turns to 109 degrees.
    truth = pose.exp(np.r_[angle * np.array([0.6, -0.64, 0.48]), 0.3, -0.2, 0.5])
    moved = pose.apply(truth, P)
    slid = moved + np.cross(N, RNG.normal(size=(40, 3)))
    reached = local_minimum(form(plane_form(P, slid, N, W, ZERO)), solve(P, slid).T_target_source)
    np.testing.assert_allclose(reached, truth, atol=1e-9)


def test_a_free_motion_stays_where_it_was():
    up = np.tile([0.0, 0.0, 1.0], (40, 1))
    flat = P * [1, 1, 0]
    start = pose.exp([0.05, -0.03, 0.0, 0.4, 0.5, 0.2])
    reached = local_minimum(form(plane_form(flat, flat, up, W, ZERO)), start)
    assert form(plane_form(flat, flat, up, W, ZERO)).value(reached) < 1e-20
    # The sum of shifts within the plane and turns about its normal is what it was, to second order in the tilt.
    np.testing.assert_allclose(reached[:2, 3], start[:2, 3], atol=0.02)


def test_far_origins_cost_no_digits():
    far = np.array([5e5, 4.4e6, 100.0])
    truth = pose.exp([0.2, -0.1, 0.3, 0.1, 0.2, 0.3])
    moved = pose.apply(truth, P)
    origins = (far, far)
    cost = form(plane_form(P + far, moved + far, N, W, origins), origins)
    reached = local_minimum(cost, np.eye(4))
    back = pose.apply(reached, P + far) - far
    # One unit in the last place of 4.4e6 is 9e-10.
    np.testing.assert_allclose(back, moved, atol=4e-9)
