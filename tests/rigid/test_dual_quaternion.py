from __future__ import annotations

import copy
import itertools
import pickle

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import transform

from dqreg.errors import InputError
from dqreg.rigid import DualQuaternion, pose
from dqreg.rigid import quaternion as quat
from tests.strategies import floats, points, poses, unit_vectors

fast = settings(deadline=None, max_examples=50)
FRACTIONS = np.linspace(0, 1, 9)
twists = st.tuples(unit_vectors(), floats(0, 3.1), unit_vectors(), floats(0, 100)).map(
    lambda draw: np.concatenate([draw[1] * draw[0], draw[3] * draw[2]])
)


def reach(*matrices):
    """Lengths in play, for tolerances: rounding grows with the translation."""
    return 1 + sum(np.linalg.norm(T[:3, 3]) for T in matrices)


def assert_same(T, expected, length, tolerance=1e-12):
    np.testing.assert_allclose(T[:3, :3], expected[:3, :3], rtol=0, atol=tolerance)
    np.testing.assert_allclose(T[:3, 3], expected[:3, 3], rtol=0, atol=tolerance * length)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


def of(T):
    return DualQuaternion.from_matrix(T)


@fast
@given(poses())
def test_matrix_there_and_back(T):
    q = of(T)
    assert_same(q.as_matrix(), T, reach(T), 1e-14)
    np.testing.assert_array_equal(q.canonical().real, q.real)
    np.testing.assert_allclose(q.constraint_residuals(), 0, atol=1e-15 * reach(T))


@fast
@given(poses())
def test_components_agree_with_scipy(T):
    # Walker eqs. 6, 7.
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("the oracle came with SciPy 1.16")
    theirs = transform.RigidTransform.from_matrix(T).as_dual_quat(scalar_first=True)
    q = of(T)
    mine = np.concatenate([q.real, q.dual])
    theirs = theirs * np.sign(theirs[:4] @ mine[:4])
    np.testing.assert_allclose(mine[:4], theirs[:4], atol=1e-14)
    np.testing.assert_allclose(mine[4:], theirs[4:], rtol=0, atol=1e-14 * reach(T))


@fast
@given(poses(), poses(), poses())
def test_group_axioms(A, B, C):
    a, b, c = of(A), of(B), of(C)
    length, one = reach(A, B, C), DualQuaternion.identity()
    assert_same((a * b).as_matrix(), A @ B, length)
    assert_same(((a * b) * c).as_matrix(), (a * (b * c)).as_matrix(), length)
    assert_same((a * one).as_matrix(), A, length)
    assert_same((one * a).as_matrix(), A, length)
    assert_same((a * a.inverse()).as_matrix(), np.eye(4), length)
    assert_same((a.inverse() * a).as_matrix(), np.eye(4), length)
    assert_same(a.inverse().as_matrix(), pose.inverse(A), length)


@fast
@given(poses(), points(1))
def test_apply(T, p):
    length = reach(T) + np.abs(p).max()
    expected = p @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(of(T).apply(p), expected, rtol=0, atol=1e-13 * length)
    # The sandwich q (1 + eps p) q~* on dual quaternions with eight numbers.
    q = of(T)
    far = q.combined_conjugate()
    pure = np.column_stack([np.zeros(len(p)), p])
    moved = quat.multiply(q.real, far.dual) + quat.multiply(q.dual, far.real)
    moved = moved + quat.multiply(quat.multiply(q.real, pure), far.real)
    np.testing.assert_allclose(moved[:, 1:], expected, rtol=0, atol=1e-12 * length)
    np.testing.assert_allclose(moved[:, 0], 0, atol=1e-12 * length)


@fast
@given(poses(), poses())
def test_conjugates_and_norm(A, B):
    a, b = of(A), of(B)
    np.testing.assert_array_equal(a.quaternion_conjugate().real, quat.conjugate(a.real))
    np.testing.assert_array_equal(a.quaternion_conjugate().dual, quat.conjugate(a.dual))
    np.testing.assert_array_equal(a.dual_conjugate().real, a.real)
    np.testing.assert_array_equal(a.dual_conjugate().dual, -a.dual)
    np.testing.assert_array_equal(a.combined_conjugate().real, quat.conjugate(a.real))
    np.testing.assert_array_equal(a.combined_conjugate().dual, -quat.conjugate(a.dual))
    reversed_product = b.quaternion_conjugate() * a.quaternion_conjugate()
    length = reach(A, B)
    assert_same((a * b).quaternion_conjugate().as_matrix(), reversed_product.as_matrix(), length)
    kept_order = a.dual_conjugate() * b.dual_conjugate()
    assert_same((a * b).dual_conjugate().as_matrix(), kept_order.as_matrix(), length)
    norm = (a * b).norm()
    assert norm.real == pytest.approx(1, abs=1e-15)
    assert norm.dual == pytest.approx(0, abs=1e-15 * length)


@fast
@given(poses())
def test_both_signs_are_one_motion(T):
    q = of(T)
    other = DualQuaternion(-q.real, -q.dual)
    np.testing.assert_array_equal(other.as_matrix(), q.as_matrix())
    np.testing.assert_array_equal(other.canonical().real, q.real)
    np.testing.assert_array_equal(other.canonical().dual, q.dual + 0.0)
    np.testing.assert_array_equal(other.log(), q.log())
    np.testing.assert_array_equal(other.as_screw().point, q.as_screw().point)


@fast
@given(poses())
def test_exp_undoes_log(T):
    q = of(T)
    assert np.linalg.norm(q.log()[:3]) <= np.pi + 1e-15
    assert_same(DualQuaternion.exp(q.log()).as_matrix(), T, reach(T))
    if pose.angle_between(np.eye(4), T) < np.pi - 1e-9:  # rounding chooses between the two twists of a half-turn
        np.testing.assert_allclose(q.log(), pose.log(T), rtol=0, atol=1e-12 * reach(T))


@fast
@given(twists)
def test_log_undoes_exp_and_agrees_with_the_pose(twist):
    q = DualQuaternion.exp(twist)
    np.testing.assert_allclose(q.log(), twist, rtol=0, atol=1e-12 * (1 + np.abs(twist).max()))
    assert_same(q.as_matrix(), pose.exp(twist), 1 + np.abs(twist).max())


@fast
@given(twists)
def test_exp_is_the_power_series_of_the_pure_dual_quaternion(twist):
    # Left multiplication by (w + eps v) / 2 as an 8x8 matrix; its exponential sums the series.
    from scipy.linalg import expm

    w, v = (quat.left_matrix([0, *(half / 2)]) for half in (twist[:3], twist[3:]))
    total = expm(np.block([[w, np.zeros((4, 4))], [v, w]]))[:, 0]
    q = DualQuaternion.exp(twist)
    np.testing.assert_allclose(np.concatenate([q.real, q.dual]), total, atol=1e-11)


@fast
@given(poses(), floats(-2, 2), floats(-2, 2))
def test_powers(T, a, b):
    q = of(T)
    assert_same((q**1).as_matrix(), T, reach(T))
    assert_same((q**0).as_matrix(), np.eye(4), 1)
    assert_same((q**2).as_matrix(), T @ T, reach(T))
    assert_same((q**-1).as_matrix(), pose.inverse(T), reach(T))
    assert_same((q**a * q**b).as_matrix(), (q ** (a + b)).as_matrix(), 10 * reach(T))


@fast
@given(poses(), floats(0.1, 0.9))
def test_power_scales_the_screw(T, rho):
    q = of(T)
    whole, part = q.as_screw(), (q**rho).as_screw()
    assert part.angle_rad == pytest.approx(rho * whole.angle_rad, abs=1e-14)
    assume(1e-3 < whole.angle_rad < np.pi - 1e-3)
    np.testing.assert_allclose(part.axis, whole.axis, atol=1e-11)
    assert part.distance == pytest.approx(rho * whole.distance, abs=1e-9 * reach(T))
    np.testing.assert_allclose(part.point, whole.point, rtol=0, atol=1e-8 * reach(T))


@fast
@given(poses(), poses())
def test_sclerp_ends_and_constant_speed(A, B):
    a, b, length = of(A), of(B), reach(A, B)
    path = [a.sclerp(b, f) for f in FRACTIONS]
    assert_same(path[0].as_matrix(), A, length)
    assert_same(path[-1].as_matrix(), B, length)
    steps = [(p.inverse() * n).as_matrix() for p, n in itertools.pairwise(path)]
    for step in steps[1:]:
        assert_same(step, steps[0], length, 1e-11)


def test_sclerp_takes_the_shorter_turn():
    a = DualQuaternion.identity()
    b = DualQuaternion.from_screw([0, 0, 1], 2 * np.pi - 0.2, 4.0)
    middle = a.sclerp(b, 0.5).as_screw()
    assert middle.angle_rad == pytest.approx(0.1, abs=1e-14)
    assert abs(middle.distance) == pytest.approx(2.0, abs=1e-13)


def test_long_products_keep_the_constraints():
    step, total = of(pose.exp([0.3, -0.2, 0.5, 10, 20, -30])), DualQuaternion.identity()
    for _ in range(3000):
        total = total * step
    np.testing.assert_allclose(total.constraint_residuals(), 0, atol=1e-12)
    assert_same(total.as_matrix(), (step**3000).as_matrix(), 1, 1e-8)


@pytest.mark.parametrize(
    ("real", "dual", "words"),
    [
        (np.zeros(4), np.zeros(4), "norm 1"),
        ([2, 0, 0, 0], np.zeros(4), "norm 1"),
        ([1 + 1e-7, 0, 0, 0], np.zeros(4), "norm 1"),
        ([np.nan, 0, 0, 0], np.zeros(4), "norm 1"),
        ([1, 0, 0, 0], [np.nan, 0, 0, 0], "perpendicular"),
        ([1, 0, 0, 0], [0.5, 0, 0, 0], "perpendicular"),
        ([1, 0, 0, 0], [1e-12, 0, 0, 0], "perpendicular"),
        ([1, 0, 0], np.zeros(4), "real must hold"),
        ([1, 0, 0, 0], np.zeros((2, 3)), "dual must hold"),
        ("one", np.zeros(4), "real must be"),
    ],
)
def test_what_is_not_unit_is_refused(real, dual, words):
    # Walker eqs. 13, 14.
    with pytest.raises(InputError, match=words):
        DualQuaternion(real, dual)


def test_errors():
    with pytest.raises(InputError, match="six numbers"):
        DualQuaternion.exp([1, 2, 3])
    with pytest.raises(InputError, match="twist"):
        DualQuaternion.exp([np.inf, 0, 0, 0, 0, 0])
    with pytest.raises(InputError, match="mirror"):
        DualQuaternion.from_matrix(np.diag([1, 1, -1, 1]))
    with pytest.raises(InputError, match="points_source"):
        DualQuaternion.identity().apply([[1, 2]])
    with pytest.raises(InputError, match="factor"):
        DualQuaternion.identity() * "two"


def test_values_are_locked_and_their_sources_free():
    real, dual = np.array([1.0, 0, 0, 0]), np.zeros(4)
    q = DualQuaternion(real, dual)
    with pytest.raises(ValueError, match="read-only"):
        q.real[0] = 2.0
    with pytest.raises(AttributeError):
        q.real = real
    real[0] = 7.0
    assert q.real[0] == 1.0


def test_copies_and_pickles():
    q = of(pose.exp([1, 2, 0.5, 4, 5, 6]))
    for twin in (copy.deepcopy(q), pickle.loads(pickle.dumps(q))):
        np.testing.assert_array_equal(twin.as_matrix(), q.as_matrix())
