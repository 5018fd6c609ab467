from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from scipy.spatial.transform import Rotation, Slerp

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from dqreg.rigid._rotation import interpolate_axis
from tests.strategies import angles, floats, points, unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=40)


@fast
@given(unit_quaternions(), points(1))
def test_rotation_is_q_v_q_star_and_agrees_with_scipy(q, v):
    # Jia eq. 5.
    rotated = quat.rotate(q, v)
    pure = np.column_stack([np.zeros(len(v)), v])
    sandwich = quat.multiply(quat.multiply(q, pure), quat.conjugate(q))
    scipy_rotation = Rotation.from_quat(np.roll(q, -1))
    np.testing.assert_allclose(sandwich[:, 0], 0, atol=1e-11)
    np.testing.assert_allclose(rotated, sandwich[:, 1:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(rotated, scipy_rotation.apply(v), rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(rotated, axis=1), np.linalg.norm(v, axis=1), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(quat.rotate(-q, v), rotated, rtol=0, atol=0)
    np.testing.assert_allclose(quat.rotate_frame(q, v), scipy_rotation.inv().apply(v), rtol=0, atol=1e-11)


@fast
@given(unit_quaternions())
def test_axis_stays(q):
    np.testing.assert_allclose(quat.rotate(q, q[1:]), q[1:], atol=1e-15)


@fast
@given(unit_vectors(), angles(), unit_vectors())
def test_equation_8(u, angle_rad, v):
    # Jia eq. 8; Walker eq. 3.
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    expected = cosine * v + (1 - cosine) * (u @ v) * u + sine * np.cross(u, v)
    np.testing.assert_allclose(quat.rotate(quat.from_axis_angle(u, angle_rad), v), expected, atol=1e-14)


@fast
@given(unit_vectors(), angles())
def test_the_part_across_the_axis_turns_by_the_angle(u, angle_rad):
    # Jia eq. 7.
    # Eq. 7: L_q(n) = cos(theta) n + sin(theta) u x n for n across u.
    n = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    expected = np.cos(angle_rad) * n + np.sin(angle_rad) * np.cross(u, n)
    np.testing.assert_allclose(quat.rotate(quat.from_axis_angle(u, angle_rad), n), expected, atol=1e-14)


def test_example_2_of_the_notes():
    # A third of a turn about (1, 1, 1) permutes the axes: x goes to y. The text at hand ends with "= i", but the
    # three columns it adds up give (0, 1, 0).
    columns = np.array([[-0.5, 0, 0], [0.5, 0.5, 0.5], [0, 0.5, -0.5]])
    q = quat.from_axis_angle([1, 1, 1], 2 * np.pi / 3)
    np.testing.assert_allclose(q, [0.5, 0.5, 0.5, 0.5], atol=1e-15)
    np.testing.assert_allclose(quat.rotate(q, [1, 0, 0]), columns.sum(axis=0), atol=1e-15)
    np.testing.assert_allclose(quat.rotate(q, [1, 0, 0]), [0, 1, 0], atol=1e-15)


@fast
@given(unit_quaternions(), unit_quaternions(), unit_quaternions(), unit_vectors())
def test_sequences(p, q, r, v):
    np.testing.assert_allclose(
        quat.rotate(quat.compose(p, q, r), v), quat.rotate(r, quat.rotate(q, quat.rotate(p, v))), atol=1e-14
    )
    one_by_one = quat.rotate_frame(r, quat.rotate_frame(q, quat.rotate_frame(p, v)))
    np.testing.assert_allclose(quat.rotate_frame(quat.compose_frames(p, q, r), v), one_by_one, atol=1e-14)


@fast
@given(angles(), angles())
def test_example_3_satellite_tracking(bearing_rad, elevation_rad):
    # Jia eq. 9.
    # Eq. 9 and the lines after it, with the notes' alpha and beta.
    a, b = bearing_rad / 2, elevation_rad / 2
    composite = quat.compose_frames(
        quat.from_axis_angle([0, 0, 1], bearing_rad), quat.from_axis_angle([0, 1, 0], elevation_rad)
    )
    v = [-np.sin(a) * np.sin(b), np.cos(a) * np.sin(b), np.sin(a) * np.cos(b)]
    np.testing.assert_allclose(composite, [np.cos(a) * np.cos(b), *v], atol=1e-15)
    cosine = (np.cos(bearing_rad) * np.cos(elevation_rad) + np.cos(bearing_rad) + np.cos(elevation_rad) - 1) / 2
    assert np.cos(quat.to_axis_angle(composite)[1]) == pytest.approx(cosine, abs=1e-14)


def test_example_3_a_positive_elevation_points_down():
    # Jia, example 3 and eq. 9: the new x axis is to point towards the satellite, above the horizon.
    bearing_rad, elevation_rad = 0.5, 0.3
    composite = quat.compose_frames(
        quat.from_axis_angle([0, 0, 1], bearing_rad), quat.from_axis_angle([0, 1, 0], elevation_rad)
    )
    x_axis = quat.rotate(composite, [1, 0, 0])
    assert x_axis[2] == pytest.approx(-np.sin(elevation_rad), abs=1e-15)
    assert np.arctan2(x_axis[1], x_axis[0]) == pytest.approx(bearing_rad, abs=1e-15)


def test_equation_30_is_open_for_equal_axes():
    # Jia eq. 30, as printed: u1 x u2 over its length. Two rotations about one axis by different angles differ.
    u = np.array([0.6, 0.0, 0.8])
    normal = np.cross(u, u)
    assert np.linalg.norm(normal) == 0.0
    r1, r2 = quat.from_axis_angle(u, 0.4), quat.from_axis_angle(u, 1.0)
    np.testing.assert_allclose(quat.interpolate_axis(u, u, 0.3), u, atol=1e-15)
    expected = quat.from_axis_angle(u, 0.7)
    np.testing.assert_allclose(quat.interpolate_axis_angle(r1, r2, 0.5), expected, atol=1e-15)


@fast
@given(unit_vectors(), angles())
def test_axis_and_angle_there_and_back(u, angle_rad):
    # Jia eq. 6.
    q = quat.from_axis_angle(u, angle_rad)
    axis, back_rad = quat.to_axis_angle(q)
    assert back_rad == pytest.approx(angle_rad, abs=1e-14)
    np.testing.assert_allclose(quat.from_axis_angle(axis, back_rad), q, atol=1e-15)
    np.testing.assert_allclose(quat.from_axis_angle(-u, -angle_rad), q, atol=0)


def test_any_length_of_axis_will_do():
    for length in (1e-200, 5.0, 1e200):
        np.testing.assert_allclose(quat.from_axis_angle([0, length, 0], np.pi), [0, 0, 1, 0], atol=1e-15)


def test_shapes_broadcast():
    q = quat.from_axis_angle(np.eye(3), 0.3)
    assert q.shape == (3, 4)
    assert quat.from_axis_angle([0, 0, 1], np.linspace(0, 1, 5)).shape == (5, 4)
    assert quat.rotate(q[:, None], np.ones((7, 3))).shape == (3, 7, 3)


def test_errors():
    with pytest.raises(InputError, match="direction"):
        quat.from_axis_angle([0, 0, 0], 1.0)
    with pytest.raises(InputError, match="direction"):
        quat.from_axis_angle([0, np.nan, 0], 1.0)
    with pytest.raises(InputError, match="norm 1"):
        quat.rotate(np.zeros(4), [1, 0, 0])
    with pytest.raises(InputError, match="at least one"):
        quat.compose()
    with pytest.raises(InputError, match=r"rotations\[1\]"):
        quat.compose([1, 0, 0, 0], [2, 0, 0, 0])
    with pytest.raises(InputError, match="v must hold"):
        quat.rotate([1, 0, 0, 0], [1, 0])


# An older Hypothesis draws poles so often that leaving them out looks like too much to it.
arcs = settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.filter_too_much])
FRACTIONS = np.linspace(0, 1, 11)


@arcs
@given(unit_quaternions(), unit_quaternions())
def test_slerp_ends_and_constant_speed(r1, r2):
    # Jia eq. 34.
    path = quat.slerp(r1, r2, FRACTIONS, shorter_turn=False)
    np.testing.assert_allclose(path[[0, -1]], [r1, r2], atol=1e-14)
    np.testing.assert_allclose(quat.norm(path), 1, atol=1e-14)
    # Every step is the same rotation in the world frame.
    steps = quat.multiply(path[1:], quat.conjugate(path[:-1]))
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-14)


@arcs
@given(unit_quaternions(), unit_quaternions(), floats(0, 1))
def test_slerp_is_the_great_arc(r1, r2, tau):
    # Jia eq. 34.
    cosine = np.clip(r1 @ r2, -1, 1)
    phi = np.arctan2(np.linalg.norm(r2 - cosine * r1), cosine)
    assume(1e-3 < phi < np.pi - 1e-3)
    arc = (np.sin((1 - tau) * phi) * r1 + np.sin(tau * phi) * r2) / np.sin(phi)
    np.testing.assert_allclose(quat.slerp(r1, r2, tau, shorter_turn=False), arc, atol=1e-12)


@arcs
@given(unit_quaternions(), unit_quaternions())
def test_the_shorter_turn_agrees_with_scipy(r1, r2):
    assume(abs(r1 @ r2) > 1e-6)  # at a half-turn both ways are equally short
    both = Rotation.from_quat(np.roll([r1, r2], -1, axis=1))
    expected = Slerp([0, 1], both)(FRACTIONS).as_matrix()
    np.testing.assert_allclose(quat.to_matrix(quat.slerp(r1, r2, FRACTIONS)), expected, atol=1e-9)


def test_the_notes_formula_follows_the_sign_it_is_given():
    r1, r2 = quat.from_axis_angle([0, 0, 1], 0.2), quat.from_axis_angle([0, 0, 1], 0.6)
    np.testing.assert_allclose(
        quat.slerp(r1, r2, 0.5, shorter_turn=False), quat.from_axis_angle([0, 0, 1], 0.4), atol=1e-15
    )
    long_way = quat.from_axis_angle([0, 0, 1], 0.4 - np.pi)
    np.testing.assert_allclose(quat.slerp(r1, -r2, 0.5, shorter_turn=False), long_way, atol=1e-15)
    np.testing.assert_allclose(quat.slerp(r1, -r2, 0.5), quat.slerp(r1, r2, 0.5), atol=1e-15)


@arcs
@given(unit_quaternions(), unit_quaternions())
def test_axis_and_angle_interpolation_ends(r1, r2):
    path = quat.interpolate_axis_angle(r1, r2, FRACTIONS)
    np.testing.assert_allclose(quat.norm(path), 1, atol=1e-14)
    np.testing.assert_allclose(path[[0, -1]], [r1, r2], atol=1e-14)


@arcs
@given(unit_quaternions(), unit_quaternions())
def test_axis_and_angle_change_at_constant_rates(r1, r2):
    # Jia eq. 29.
    for r in (r1, r2):
        # The axis must be readable all the way: 1e-3 keeps its rounding below 1e-12.
        assume(np.linalg.norm(r[1:]) > 1e-3)
    half1, half2 = (np.arctan2(np.linalg.norm(r[1:]), r[0]) for r in (r1, r2))
    axes, angles = quat.to_axis_angle(quat.interpolate_axis_angle(r1, r2, FRACTIONS))
    np.testing.assert_allclose(angles, 2 * ((1 - FRACTIONS) * half1 + FRACTIONS * half2), atol=1e-12)  # eq. 29
    strides = np.linalg.norm(np.diff(axes, axis=0), axis=1)
    np.testing.assert_allclose(strides, strides[0], atol=1e-11)


@arcs
@given(unit_quaternions(), unit_quaternions(), floats(0, 1))
def test_equation_33(r1, r2, tau):
    # Jia eqs. 30 to 33.
    assume(min(np.linalg.norm(r1[1:]), np.linalg.norm(r2[1:])) > 1e-3)
    (u1, theta1), (u2, theta2) = quat.to_axis_angle(r1), quat.to_axis_angle(r2)
    phi = np.arctan2(np.linalg.norm(np.cross(u1, u2)), u1 @ u2)  # eq. 31
    assume(1e-3 < phi < np.pi - 1e-3)
    half = ((1 - tau) * theta1 + tau * theta2) / 2
    u = (np.sin((1 - tau) * phi) * u1 + np.sin(tau * phi) * u2) / np.sin(phi)  # eq. 32
    expected = [np.cos(half), *(np.sin(half) * u)]
    np.testing.assert_allclose(quat.interpolate_axis_angle(r1, r2, tau), expected, atol=1e-11)


@arcs
@given(unit_vectors(), floats(0, 1))
def test_opposite_axes_meet_in_the_vertical_plane(u, tau):
    # Jia eqs. 30 to 32.
    # After eq. 30: the plane's normal is (-u_y, u_x, 0), or x for vertical axes.
    middle = interpolate_axis(u, -u, tau)
    normal = np.array([-u[1], u[0], 0]) if np.hypot(u[0], u[1]) > 0 else np.array([1.0, 0, 0])
    assert np.linalg.norm(middle) == pytest.approx(1, abs=1e-14)
    assert middle @ normal == pytest.approx(0, abs=1e-14)
    assert u @ middle == pytest.approx(np.cos(tau * np.pi), abs=1e-14)
    # The side follows the sign of that normal: the axis turns about it, right-handed.
    side = np.cross(normal, u) / np.linalg.norm(normal)
    np.testing.assert_allclose(middle, np.cos(tau * np.pi) * u + np.sin(tau * np.pi) * side, atol=1e-14)


@pytest.mark.parametrize("gap_rad", [0.0, 1e-15, 1e-9, 1e-7])
def test_nearly_equal_and_nearly_opposite_axes(gap_rad):
    u = np.array([0.6, 0.0, 0.8])
    near = np.cos(gap_rad) * u + np.sin(gap_rad) * np.array([0.0, 1.0, 0.0])
    for end in (near, -near):
        path = interpolate_axis(u, end, FRACTIONS)
        np.testing.assert_allclose(np.linalg.norm(path, axis=1), 1, atol=1e-14)
        np.testing.assert_allclose(path[[0, -1]], [u, end], atol=1e-14)


def test_a_rotation_that_does_not_turn_takes_the_other_axis():
    quarter = quat.from_axis_angle([0, 1, 0], np.pi / 2)
    expected = quat.from_axis_angle([0, 1, 0], np.pi / 8)
    np.testing.assert_allclose(quat.interpolate_axis_angle([1, 0, 0, 0], quarter, 0.25), expected, atol=1e-15)
    np.testing.assert_allclose(quat.interpolate_axis_angle(quarter, [1, 0, 0, 0], 0.75), expected, atol=1e-15)
    np.testing.assert_array_equal(quat.interpolate_axis_angle([1, 0, 0, 0], [1, 0, 0, 0], 0.5), [1, 0, 0, 0])


def test_stacks():
    rng = np.random.default_rng(5)
    r1, r2 = quat.normalize(rng.normal(size=(2, 4, 4)))
    for blend in (quat.slerp, quat.interpolate_axis_angle):
        path = blend(r1, r2, FRACTIONS[:, None])
        assert path.shape == (11, 4, 4)
        np.testing.assert_allclose(path[3, 2], blend(r1[2], r2[2], FRACTIONS[3]), atol=1e-15)


@pytest.mark.parametrize("blend", [quat.slerp, quat.interpolate_axis_angle])
def test_errors_of_interpolation(blend):
    with pytest.raises(InputError, match="r2 must have norm 1"):
        blend([1, 0, 0, 0], np.zeros(4), 0.5)
    with pytest.raises(InputError, match="r1 must hold"):
        blend([1, 0, 0], [1, 0, 0, 0], 0.5)
