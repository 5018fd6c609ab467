from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.strategies import angles, points, unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=40)


@fast
@given(unit_quaternions(), points(1))
def test_rotation_is_q_v_q_star_and_agrees_with_scipy(q, v):
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
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    expected = cosine * v + (1 - cosine) * (u @ v) * u + sine * np.cross(u, v)
    np.testing.assert_allclose(quat.rotate(quat.from_axis_angle(u, angle_rad), v), expected, atol=1e-14)


@fast
@given(unit_vectors(), angles())
def test_the_part_across_the_axis_turns_by_the_angle(u, angle_rad):
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
    # Eq. 9 and the lines after it, with the notes' alpha and beta.
    a, b = bearing_rad / 2, elevation_rad / 2
    composite = quat.compose_frames(
        quat.from_axis_angle([0, 0, 1], bearing_rad), quat.from_axis_angle([0, 1, 0], elevation_rad)
    )
    v = [-np.sin(a) * np.sin(b), np.cos(a) * np.sin(b), np.sin(a) * np.cos(b)]
    np.testing.assert_allclose(composite, [np.cos(a) * np.cos(b), *v], atol=1e-15)
    cosine = (np.cos(bearing_rad) * np.cos(elevation_rad) + np.cos(bearing_rad) + np.cos(elevation_rad) - 1) / 2
    assert np.cos(quat.to_axis_angle(composite)[1]) == pytest.approx(cosine, abs=1e-14)


@fast
@given(unit_vectors(), angles())
def test_axis_and_angle_there_and_back(u, angle_rad):
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
