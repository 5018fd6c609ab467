from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.rigid import DualNumber, DualQuaternion, Screw, _dual_parts, pose
from dqreg.rigid import quaternion as quat
from tests.strategies import floats, poses, unit_vectors

fast = settings(deadline=None, max_examples=50)
places = st.tuples(*[floats(-10, 10)] * 3).map(np.array)


def matrix_of(screw):
    """Turn about the line, then shift along it, written without dual numbers (eqs. 61-62)."""
    n, theta, d, p = screw
    K = quat.cross_matrix(n)
    R = np.cos(theta) * np.eye(3) + (1 - np.cos(theta)) * np.outer(n, n) + np.sin(theta) * K
    return pose.from_parts(R, (np.eye(3) - R) @ p + d * n)


@fast
@given(unit_vectors(), floats(-7, 7), floats(-5, 5), places)
def test_from_screw_is_the_motion_of_equation_61(n, theta, d, p):
    # Walker eqs. 8 to 10 and 60 to 62.
    q = DualQuaternion.from_screw(n, theta, d, p)
    np.testing.assert_allclose(q.as_matrix(), matrix_of(Screw(n, theta, d, p)), atol=1e-13)
    # A point of the line moves along it only.
    np.testing.assert_allclose(q.apply(p), p + d * n, atol=1e-12)


@fast
@given(unit_vectors(), floats(-7, 7), floats(-5, 5), places)
def test_equations_11_12_and_61_to_66(n, theta, d, p):
    # Walker eqs. 11 to 14 and 63 to 66.
    real, dual = _dual_parts.from_screw(n, theta, d, p)
    sine, cosine, moment, K = np.sin(theta / 2), np.cos(theta / 2), np.cross(p, n), quat.cross_matrix(n)
    np.testing.assert_allclose(real, [cosine, *(sine * n)], atol=1e-15)  # eq. 11
    expected = [-d / 2 * sine, *(d / 2 * cosine * n + sine * moment)]
    np.testing.assert_allclose(dual, expected, atol=1e-14)  # eq. 12
    assert real @ real == pytest.approx(1, abs=1e-15)  # eq. 13
    assert real @ dual == pytest.approx(0, abs=1e-14)  # eq. 14
    np.testing.assert_allclose(np.outer(n, n), np.eye(3) + K @ K, atol=1e-15)  # before eq. 63
    R = np.eye(3) + 2 * sine**2 * K @ K + np.sin(theta) * K
    np.testing.assert_allclose(quat.to_matrix(real), R, atol=1e-14)  # eq. 63
    t = 2 * sine**2 * np.cross(n, moment) + np.sin(theta) * moment + d * n
    np.testing.assert_allclose((np.eye(3) - R) @ p + d * n, t, atol=1e-13)  # eqs. 61 and 64
    r, s = real[1:], dual[1:]
    np.testing.assert_allclose(real[0] * s - dual[0] * r, (d * n + np.sin(theta) * moment) / 2, atol=1e-13)  # 65
    np.testing.assert_allclose(np.cross(r, s), sine**2 * np.cross(n, moment), atol=1e-13)  # eq. 66


@fast
@given(unit_vectors(), floats(0.01, 3.14), floats(-5, 5), places)
def test_equation_70_has_the_other_sign(n, theta, d, p):
    # Walker eq. 70.
    _, dual = _dual_parts.from_screw(n, theta, d, p)
    assert -2 * dual[0] / np.sin(theta / 2) == pytest.approx(d, abs=1e-11)
    if abs(d) > 0.1:
        assert 2 * dual[0] / np.sin(theta / 2) != pytest.approx(d, abs=0.1)  # as printed


@fast
@given(unit_vectors(), floats(0.01, 3.14), floats(-5, 5), places, floats(-3, 3))
def test_equations_71_to_75(n, theta, d, p, alpha):
    # Walker eqs. 71 to 75.
    _, dual = _dual_parts.from_screw(n, theta, d, p)
    s, sine = dual[1:], np.sin(theta / 2)
    m = (s - d / 2 * np.cos(theta / 2) * n) / sine  # eqs. 71-72
    np.testing.assert_allclose(quat.cross_matrix(-n) @ p, m, atol=1e-11)  # eq. 73
    nearest = np.cross(n, m)
    np.testing.assert_allclose(np.cross(nearest + alpha * n, n), m, atol=1e-11)  # eq. 74
    np.testing.assert_allclose(_dual_parts.as_screw(*_dual_parts.from_screw(n, theta, d, p)).point, nearest, atol=1e-11)
    assume(abs(n[0]) > 0.1)
    zero_first = np.array([0, -m[2], m[1]]) / n[0]  # eq. 75, mended
    np.testing.assert_allclose(np.cross(zero_first, n), m, atol=1e-10)


def test_equation_75_as_printed_misses_the_line():
    # Walker eq. 75.
    # A line along x through (0, 0, 1): printed, its point is a multiple of (0, 0, 0).
    n, p = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])
    printed = np.array([0, -n[2], n[1]]) / n[0]
    assert not printed.any()
    np.testing.assert_allclose(DualQuaternion.from_screw(n, 1.0, 2.0, p).as_screw().point, p, atol=1e-15)


@fast
@given(poses())
# A shift whose square has hardly a digit.
@example(np.array([[1.0, 0, 0, 6.03838845e-155], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
def test_every_pose_is_its_screw(T):
    screw = DualQuaternion.from_matrix(T).as_screw()
    assert 0 <= screw.angle_rad <= np.pi
    assert np.linalg.norm(screw.axis) == pytest.approx(1, abs=1e-15)
    length = 1 + np.linalg.norm(T[:3, 3])
    if screw.angle_rad > 0:  # the point is t over the angle, and so is its rounding
        assert screw.point @ screw.axis == pytest.approx(0, abs=1e-15 * (1 + 4 * length / screw.angle_rad))
    back = DualQuaternion.from_screw(*screw).as_matrix()
    np.testing.assert_allclose(back[:3, :3], T[:3, :3], atol=1e-14)
    np.testing.assert_allclose(back[:3, 3], T[:3, 3], rtol=0, atol=1e-12 * length)


@fast
@given(unit_vectors(), floats(0.01, 3.14), floats(-5, 5), places)
def test_the_screw_comes_back(n, theta, d, p):
    screw = DualQuaternion.from_screw(n, theta, d, p).as_screw()
    np.testing.assert_allclose(screw.axis, n, atol=1e-13)
    assert screw.angle_rad == pytest.approx(theta, abs=1e-14)
    assert screw.distance == pytest.approx(d, abs=1e-12)
    np.testing.assert_allclose(screw.point, p - (n @ p) * n, atol=1e-11)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -0.6, 0.8]])
def test_half_turns(axis):
    axis = np.array(axis, dtype=float)
    p = np.cross(axis, [3.0, 1.0, 2.0])
    T = matrix_of(Screw(axis, np.pi, 5.0, p))
    screw = DualQuaternion.from_matrix(T).as_screw()
    sign = np.sign(screw.axis @ axis)  # either direction will do for half a turn
    np.testing.assert_allclose(sign * screw.axis, axis, atol=1e-12)
    assert screw.angle_rad == pytest.approx(np.pi, abs=1e-12)
    assert sign * screw.distance == pytest.approx(5, abs=1e-12)
    np.testing.assert_allclose(screw.point, p, atol=1e-12)


def test_a_pure_translation_has_its_own_direction_as_axis():
    screw = DualQuaternion.from_matrix(pose.from_parts(np.eye(3), [0, -3, 4])).as_screw()
    np.testing.assert_allclose(screw.axis, [0, -0.6, 0.8], atol=1e-15)
    assert (screw.angle_rad, screw.distance) == (0.0, 5.0)
    np.testing.assert_array_equal(screw.point, 0)


def test_the_identity_does_nothing_along_x():
    screw = DualQuaternion.identity().as_screw()
    assert (screw.angle_rad, screw.distance) == (0.0, 0.0)
    np.testing.assert_array_equal(screw.axis, [1, 0, 0])


def test_turns_of_1e_7():
    q = DualQuaternion.from_screw([0, 0.6, 0.8], 1e-7, 2.0, [1, 0, 0])
    screw = q.as_screw()
    np.testing.assert_allclose(screw.axis, [0, 0.6, 0.8], atol=1e-12)
    assert screw.angle_rad == pytest.approx(1e-7, abs=1e-20)
    assert screw.distance == pytest.approx(2, abs=1e-12)
    np.testing.assert_allclose(DualQuaternion.from_screw(*screw).as_matrix(), q.as_matrix(), atol=1e-14)


def test_only_the_direction_of_the_axis_counts():
    long, unit = (DualQuaternion.from_screw([0, 0, z], 0.5, 2.0, [1, 2, 3]) for z in (9, 1))
    np.testing.assert_array_equal(long.dual, unit.dual)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0, 0, 0], 1.0, 0.0, [0, 0, 0]), "direction"),
        (([0, 0, 1], np.nan, 0.0, [0, 0, 0]), "angle"),
        (([0, 0, 1], 1.0, np.inf, [0, 0, 0]), "distance"),
        (([0, 0, 1], 1.0, 0.0, [0, 0, np.nan]), "point"),
        (([0, 0, 1], 1.0, 0.0, [0, 0]), "point must hold x, y, z"),
        ((np.eye(2), 1.0, 0.0, [0, 0, 0]), "axis must hold"),
    ],
)
def test_errors(arguments, words):
    with pytest.raises(InputError, match=words):
        DualQuaternion.from_screw(*arguments)


dual_numbers = st.builds(DualNumber, floats(-10, 10), floats(-10, 10))


def matrix(a):
    """The 2x2 matrices [[a, b], [0, a]] add and multiply as dual numbers do: eps is [[0, 1], [0, 0]]."""
    return np.array([[a.real, a.dual], [0.0, a.real]])


@fast
@given(dual_numbers, dual_numbers)
def test_equation_51(a, b):
    # Walker eq. 51.
    np.testing.assert_array_equal(matrix(a + b), matrix(a) + matrix(b))
    np.testing.assert_array_equal(matrix(a - b), matrix(a) - matrix(b))
    np.testing.assert_allclose(matrix(a * b), matrix(a) @ matrix(b), rtol=0, atol=1e-13)


@fast
@given(dual_numbers)
def test_equations_53_and_54(a):
    # Walker eqs. 53, 54.
    assert a * a.conjugate() == DualNumber(a.real * a.real, 0.0)
    assert a.modulus() == a.real


@fast
@given(floats(-3, 3), floats(-10, 10))
def test_equations_55_to_59(theta, d):
    # Walker eqs. 55 to 57.
    # sin and cos of a dual angle (eq. 52); eq. 59 with eps^2 = 0 is a derivative, so differences are its oracle.
    angle = DualNumber(theta, d)
    h = 1e-5
    for function, value in ((math.sin, angle.sin()), (math.cos, angle.cos())):
        assert value.real == function(theta)
        slope = (function(theta + h) - function(theta - h)) / (2 * h)
        assert value.dual == pytest.approx(d * slope, abs=1e-8)
    one = angle.sin() * angle.sin() + angle.cos() * angle.cos()
    assert one.real == pytest.approx(1, abs=1e-15)
    assert one.dual == pytest.approx(0, abs=1e-14)


@fast
@given(dual_numbers)
def test_a_power_series_ends_after_the_slope(a):
    # Walker eqs. 58, 59.
    # Eqs. 58-59 for x^3: the product of three equals f(a) + eps b f'(a).
    cube = a * a * a
    extended = a.extend(lambda x: x**3, lambda x: 3 * x**2)
    assert cube.real == pytest.approx(extended.real, rel=1e-14, abs=1e-300)
    assert cube.dual == pytest.approx(extended.dual, rel=1e-13, abs=1e-300)


@fast
@given(floats(1e-3, 1e3), floats(-10, 10))
def test_square_root(a, b):
    root = DualNumber(a, b).sqrt()
    assert (root * root).real == pytest.approx(a, rel=1e-15)
    assert (root * root).dual == pytest.approx(b, rel=1e-14)


@pytest.mark.parametrize("real", [0.0, -1.0, math.nan])
def test_no_root_without_a_slope(real):
    with pytest.raises(InputError, match="positive"):
        DualNumber(real, 1.0).sqrt()
