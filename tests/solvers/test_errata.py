"""What docs/errata.md claims of the solution, each point checked from what is printed, not from our code."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.rigid import pose
from dqreg.rigid.quaternion import cross_matrix, left_matrix, right_matrix
from dqreg.solvers import PoseCost, svd, walker, walker1991

RNG = np.random.default_rng(17)
T_TRUE = pose.random(RNG, reach=3.0)
MODEL = RNG.uniform(-1, 1, (5, 3))
MEASURED = pose.apply(T_TRUE, MODEL)
N_MODEL = RNG.standard_normal((2, 3))
N_MODEL /= np.linalg.norm(N_MODEL, axis=1, keepdims=True)
N_MEASURED = pose.rotate(T_TRUE, N_MODEL)
LAST = [1, 2, 3, 0]  # scalar first to the paper's order


def Q(a):
    return left_matrix(np.roll(a, 1))[np.ix_(LAST, LAST)]


def W(a):
    return right_matrix(np.roll(a, 1))[np.ix_(LAST, LAST)]


def box(n_tilde, n_zero, p_tilde, p_zero, k, l):  # noqa: E741
    """Steps 1 to 4 of the box, letter by letter, with alpha = beta = 1: T from the symbols that stand in the sums."""
    C1 = -2 * sum(Q(n_tilde[i]).T @ W(n_zero[i]) for i in range(k))
    C1 = C1 - 2 * sum(Q(p_tilde[i]).T @ W(p_zero[i]) for i in range(l))
    C2, C3 = l * np.eye(4), 2 * sum(W(p_zero[i]) - Q(p_tilde[i]) for i in range(l))
    inverse = np.linalg.inv(C2 + C2.T)
    A = 0.5 * (C3.T @ inverse @ C3 - C1 - C1.T)
    r = np.linalg.eigh(A)[1][:, -1]
    s = -inverse @ C3 @ r
    T = np.eye(4)
    T[:3, :3] = (W(r).T @ Q(r))[:3, :3]
    T[:3, 3] = 2 * (W(r).T @ s)[:3]  # half points make half of t
    return T


def halves(points):
    return np.column_stack([0.5 * points, np.zeros(len(points))])


def whole(directions):
    return np.column_stack([directions, np.zeros(len(directions))])


def test_the_steps_of_the_box_map_model_to_measurement():
    # The tilde under Q is the measurement, what stands under W the model: so the steps are eqs. 35 to 37.
    found = box(whole(N_MEASURED), whole(N_MODEL), halves(MEASURED), halves(MODEL), 2, 5)
    np.testing.assert_allclose(found, T_TRUE, atol=1e-12)
    # Were the inputs line right, the superscript 0 under W would be the measurement: then the inverse comes out.
    swapped = box(whole(N_MODEL), whole(N_MEASURED), halves(MODEL), halves(MEASURED), 2, 5)
    np.testing.assert_allclose(swapped, pose.inverse(T_TRUE), atol=1e-12)
    assert np.abs(swapped - T_TRUE).max() > 0.1


def test_the_sums_of_the_box_run_over_k_directions_and_l_points():
    symbols = (whole(N_MEASURED), whole(N_MODEL), halves(MEASURED), halves(MODEL))
    np.testing.assert_allclose(box(*symbols, k=len(N_MODEL), l=len(MODEL)), T_TRUE, atol=1e-12)
    with pytest.raises(IndexError):  # the inputs line: k points and l directions
        box(*symbols, k=len(MODEL), l=len(N_MODEL))


def test_two_steps_are_the_joint_minimum():
    # Walker section 1 against eqs. 13 and 45: rotation first, then the translation that belongs to it, is no worse than
    # both together. On noisy points the gradient of the joint cost vanishes at the answer of two steps.
    noisy = MEASURED + 0.1 * RNG.standard_normal(MEASURED.shape)
    two, joint = svd(MODEL, noisy), walker1991(MODEL, noisy)
    np.testing.assert_allclose(two.T_target_source, joint.T_target_source, atol=1e-12)
    assert walker.E(two.T_target_source, MODEL, noisy) == pytest.approx(joint.cost, rel=1e-12)
    np.testing.assert_allclose(PoseCost.points(MODEL, noisy).gradient(two.T_target_source), 0, atol=1e-12)
    for twist in 1e-3 * RNG.standard_normal((20, 6)):
        assert walker.E(pose.exp(twist) @ two.T_target_source, MODEL, noisy) > joint.cost


def test_translation_and_rotation_do_not_commute():
    # Walker section 2.1: with one t, first translating and then rotating is R (p + t), the other order R p + t.
    R, t, p = T_TRUE[:3, :3], T_TRUE[:3, 3], MODEL[0]
    assert np.linalg.norm(R @ (p + t) - (R @ p + t)) > 0.1
    np.testing.assert_allclose(R @ (p + t), R @ p + R @ t, atol=1e-14)


def test_three_of_nine_elements_are_independent():
    # Jia sections 1 and 5: R^T R = I are six conditions of full rank, and 9 - 6 = 3 motions of R are left.
    R = T_TRUE[:3, :3]
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    conditions = np.zeros((6, 3, 3))
    for row, (i, j) in enumerate(pairs):
        conditions[row, :, i] += R[:, j]
        conditions[row, :, j] += R[:, i]
    assert np.linalg.matrix_rank(conditions.reshape(6, 9)) == 6
    motions = np.array([(cross_matrix(axis) @ R).ravel() for axis in np.eye(3)])
    assert np.linalg.matrix_rank(motions) == 3
    np.testing.assert_allclose(conditions.reshape(6, 9) @ motions.T, 0, atol=1e-14)


def test_the_letters_of_the_fit_are_those_of_the_paper():
    # Walker eqs. 26, 27, 31, 34, 35, 36, 37, 46 and 47, each written out here.
    fit = walker1991(MODEL, MEASURED + 0.05, N_MODEL, N_MEASURED, 2.0, 3.0)
    p0, p = walker.position_quaternions(MODEL), walker.position_quaternions(MEASURED + 0.05)
    n0, n = walker.direction_quaternions(N_MODEL), walker.direction_quaternions(N_MEASURED)
    np.testing.assert_array_equal(p0, halves(MODEL))
    np.testing.assert_array_equal(n0, whole(N_MODEL))
    C1 = -2 * sum(3.0 * Q(b).T @ W(a) for a, b in zip(n0, n, strict=True))
    C1 = C1 - 2 * sum(2.0 * Q(b).T @ W(a) for a, b in zip(p0, p, strict=True))
    np.testing.assert_allclose(fit.C1, C1, atol=1e-13)
    np.testing.assert_allclose(fit.C2, 10.0 * np.eye(4), atol=1e-13)
    np.testing.assert_allclose(fit.C3, 2 * sum(2.0 * (W(a) - Q(b)) for a, b in zip(p0, p, strict=True)), atol=1e-13)
    np.testing.assert_allclose(fit.A @ fit.r, fit.lambda_1 * fit.r, atol=1e-12)
    form = fit.r @ fit.C1 @ fit.r + fit.s @ fit.C2 @ fit.s + fit.s @ fit.C3 @ fit.r + fit.constant
    assert form == pytest.approx(fit.cost, abs=1e-11)
    arguments = (MODEL, MEASURED + 0.05, N_MODEL, N_MEASURED, 2.0, 3.0)
    assert walker.E(fit.T_target_source, *arguments) == pytest.approx(fit.cost, rel=1e-12)
    assert walker.E(T_TRUE, *arguments) == pytest.approx(2.0 * 5 * 3 * 0.05**2 / 4, rel=1e-10)
