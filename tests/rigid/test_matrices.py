from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.strategies import quaternions, rotations, unit_quaternions

fast = settings(deadline=None, max_examples=50)


@fast
@given(unit_quaternions())
def test_matrix_agrees_with_scipy(q):
    # SciPy puts the scalar last.
    np.testing.assert_allclose(quat.to_matrix(q), Rotation.from_quat(np.roll(q, -1)).as_matrix(), atol=1e-14)


@fast
@given(rotations())
def test_quaternion_of_a_matrix_agrees_with_scipy(R):
    q, other = quat.from_matrix(R), np.roll(Rotation.from_matrix(R).as_quat(), 1)
    assert min(np.abs(q - other).max(), np.abs(q + other).max()) < 1e-14
    np.testing.assert_allclose(quat.to_matrix(q), R, atol=1e-14)
    assert quat.norm(q) == pytest.approx(1.0, abs=1e-15)


@fast
@given(unit_quaternions())
def test_there_and_back(q):
    back = quat.from_matrix(quat.to_matrix(q))
    assert min(np.abs(q - back).max(), np.abs(q + back).max()) < 1e-14


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1e-9, 0, 1], [-3, 2, 1]])
@pytest.mark.parametrize("gap_rad", [0.0, 1e-15, 1e-7, 1e-4, -1e-7])
def test_every_branch_near_half_turns(axis, gap_rad):
    # Walker eqs. 23, 24.
    u = np.asarray(axis) / np.linalg.norm(axis)
    q = quat.from_axis_angle(u, np.pi - gap_rad)
    back = quat.from_matrix(quat.to_matrix(q))
    assert min(np.abs(q - back).max(), np.abs(q + back).max()) < 1e-14


def test_tiny_turns_keep_their_digits():
    angle_rad = 1e-7
    q = quat.from_matrix(Rotation.from_rotvec([0, angle_rad, 0]).as_matrix())
    assert q[2] == pytest.approx(angle_rad / 2, abs=1e-16)


def test_walkers_equations_21_to_24():
    # Walker eqs. 21 to 24.
    R = Rotation.from_rotvec([0.3, -0.7, 0.4]).as_matrix()
    r4 = np.sqrt(np.trace(R) + 1) / 2  # eq. 21
    r = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * r4)  # eq. 22
    np.testing.assert_allclose(quat.from_matrix(R), [r4, *r], atol=1e-15)
    n = np.array([2.0, -1.0, 2.0]) / 3
    half_turn = 2 * np.outer(n, n) - np.eye(3)
    column = ((half_turn + np.eye(3)) / 2)[:, 0]  # eq. 23
    np.testing.assert_allclose(quat.from_matrix(half_turn), [0, *(column / np.linalg.norm(column))], atol=1e-15)  # 24


@fast
@given(quaternions(), quaternions())
def test_product_matrices(p, q):
    scale = np.linalg.norm(p) * np.linalg.norm(q)
    np.testing.assert_allclose(quat.left_matrix(p) @ q, quat.multiply(p, q), rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(quat.right_matrix(q) @ p, quat.multiply(p, q), rtol=0, atol=1e-14 * scale)


def test_stacks():
    rng = np.random.default_rng(2)
    q = quat.canonical(quat.normalize(rng.normal(size=(3, 2, 4))))
    R = quat.to_matrix(q)
    assert R.shape == (3, 2, 3, 3)
    np.testing.assert_allclose(quat.from_matrix(R), q, atol=1e-14)
    np.testing.assert_array_equal(quat.left_matrix(q)[2, 1], quat.left_matrix(q[2, 1]))
    assert quat.from_matrix(np.zeros((0, 3, 3))).shape == (0, 4)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1.0, 1.0, -1.0]), "mirror image"),
        (2 * np.eye(3), "orthonormal"),
        (np.zeros((3, 3)), "orthonormal"),
        (np.full((3, 3), np.nan), "orthonormal"),
        (np.eye(4), "3x3"),
    ],
)
def test_what_is_no_rotation_is_refused(matrix, words):
    with pytest.raises(InputError, match=words):
        quat.from_matrix(matrix)


@pytest.mark.parametrize("q", [np.zeros(4), [1, 1, 0, 0], [1.001, 0, 0, 0], [np.nan, 0, 0, 0]])
def test_what_is_no_unit_quaternion_is_refused(q):
    with pytest.raises(InputError, match="norm 1"):
        quat.to_matrix(q)
