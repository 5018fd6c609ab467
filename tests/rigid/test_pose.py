from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial import transform
from scipy.spatial.transform import Rotation

from dqreg.errors import InputError
from dqreg.rigid import pose
from tests.strategies import floats, points, poses, unit_vectors

fast = settings(deadline=None, max_examples=50)


def reach(*matrices):
    return 1 + sum(np.linalg.norm(T[:3, 3]) for T in matrices)


@fast
@given(poses(), points())
def test_apply_and_rotate_agree_with_scipy(T, p):
    # Walker eq. 1.
    scale = 1e-13 * (reach(T) + np.abs(p).max(initial=0))
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("the oracle came with SciPy 1.16")
    expected = transform.RigidTransform.from_matrix(T).apply(p) if len(p) else p
    np.testing.assert_allclose(pose.apply(T, p), expected, rtol=0, atol=scale)
    np.testing.assert_allclose(pose.rotate(T, p), pose.apply(T, p) - T[:3, 3], rtol=0, atol=scale)


@fast
@given(poses(), poses(), points(1))
def test_group_action(A, B, p):
    scale = 1e-12 * (reach(A, B) + np.abs(p).max())
    np.testing.assert_allclose(pose.apply(A @ B, p), pose.apply(A, pose.apply(B, p)), rtol=0, atol=scale)
    np.testing.assert_allclose(pose.apply(pose.inverse(A), pose.apply(A, p)), p, rtol=0, atol=scale)
    np.testing.assert_allclose(pose.inverse(A) @ A, np.eye(4), rtol=0, atol=1e-12 * reach(A))
    np.testing.assert_allclose(pose.inverse(pose.inverse(A)), A, rtol=0, atol=1e-12 * reach(A))


def test_any_memory_layout_and_no_argument_changes():
    rng = np.random.default_rng(9)
    T, wide = pose.random(rng, reach=5.0), rng.normal(size=(40, 6))
    strided, plain = wide[::2, 1:4], np.ascontiguousarray(wide[::2, 1:4])
    plain.flags.writeable = False
    T.flags.writeable = False
    expected = np.array([T[:3, :3] @ p + T[:3, 3] for p in plain])
    for p in (strided, plain, np.asfortranarray(plain), plain.tolist(), plain[::-1][::-1]):
        np.testing.assert_allclose(pose.apply(T, p), expected, atol=1e-14)
        assert pose.apply(T, p) is not p
    np.testing.assert_allclose(pose.apply(T, plain.astype(np.float32)), expected, atol=1e-6)
    assert pose.apply(T, plain.astype(np.float32)).dtype == np.float64
    np.testing.assert_array_equal(strided, plain)
    np.testing.assert_allclose(pose.apply(T, plain[0]), expected[0], atol=1e-14)
    assert pose.apply(T, np.zeros((0, 3))).shape == (0, 3)
    np.testing.assert_allclose(pose.apply(np.asfortranarray(T), plain), expected, atol=1e-14)


@fast
@given(poses(), poses())
def test_angle_between_agrees_with_scipy(A, B):
    apart = Rotation.from_matrix(A[:3, :3]).inv() * Rotation.from_matrix(B[:3, :3])
    assert pose.angle_between(A, B) == pytest.approx(apart.magnitude(), abs=1e-14)
    assert pose.angle_between(A, B) == pytest.approx(pose.angle_between(B, A), abs=1e-15)


@fast
@given(unit_vectors(), floats(0, np.pi), poses())
def test_angle_between_finds_the_angle(axis, angle_rad, A):
    B = A @ pose.exp([*(angle_rad * axis), 1, 2, 3])
    assert pose.angle_between(A, B) == pytest.approx(angle_rad, abs=2e-15)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-9, 1e-7, np.pi - 1e-9, np.pi - 1e-12, np.pi])
def test_angles_near_zero_and_pi_keep_their_digits(angle_rad):
    T = pose.exp([0, angle_rad, 0, 0, 0, 0])
    assert pose.angle_between(np.eye(4), T) == pytest.approx(angle_rad, rel=1e-12, abs=1e-300)


@fast
@given(poses(), poses(), points(1))
def test_offset_is_the_distance_between_images(A, B, p):
    scale = 1e-12 * (reach(A, B) + np.abs(p).max())
    expected = np.linalg.norm(pose.apply(A, p) - pose.apply(B, p), axis=1)
    np.testing.assert_allclose(pose.offset_between(A, B, at=p), expected, rtol=0, atol=scale)
    assert pose.offset_between(A, B) == pytest.approx(np.linalg.norm(A[:3, 3] - B[:3, 3]), abs=scale)
    assert pose.offset_between(A, A, at=p[0]) == 0.0


def test_offset_far_away_keeps_its_digits():
    A, B = (pose.from_parts(np.eye(3), [1e6, 0, z]) for z in (0.0, 1e-9))
    assert pose.offset_between(A, B, at=[1e6, 0, 0]) == 1e-9


@fast
@given(poses(), points(1, 1))
def test_about_moves_the_centre_like_the_origin(T, c):
    c = c[0]
    moved = pose.about(T, c)
    scale = 1e-12 * (reach(T) + np.abs(c).max())
    np.testing.assert_allclose(pose.apply(moved, c), c + T[:3, 3], rtol=0, atol=scale)
    shift = pose.from_parts(np.eye(3), c)
    np.testing.assert_allclose(moved, shift @ T @ pose.inverse(shift), rtol=0, atol=scale)


def test_random_poses_are_uniform():
    T = pose.random(np.random.default_rng(10), reach=2.0, shape=(20000,))
    np.testing.assert_allclose(np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, :3] - np.eye(3), 0, atol=1e-14)
    # Uniform rotations: entries have mean 0 and mean square 1/3; 5 standard errors.
    assert np.abs(T[:, :3, :3].mean(axis=0)).max() < 5 * np.sqrt(1 / 3 / 20000)
    np.testing.assert_allclose((T[:, :3, :3] ** 2).mean(axis=0), 1 / 3, atol=5 * 0.3 / np.sqrt(20000))
    # The angle has density (1 - cos) / pi, so its mean is pi / 2 + 2 / pi.
    assert pose.angle_between(np.eye(4), T).mean() == pytest.approx(
        np.pi / 2 + 2 / np.pi, abs=5 * 0.65 / np.sqrt(20000)
    )
    # Uniform in the ball: the cube of the radius is uniform.
    cubes = (np.linalg.norm(T[:, :3, 3], axis=1) / 2.0) ** 3
    assert cubes.max() <= 1 + 1e-12
    assert cubes.mean() == pytest.approx(0.5, abs=5 * np.sqrt(1 / 12 / 20000))


def test_random_repeats_with_its_seed():
    one, two = (pose.random(np.random.default_rng(11), reach=1.0) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(pose.random(np.random.default_rng(11))[:3, 3], 0)


def test_stacks():
    rng = np.random.default_rng(12)
    A, B = pose.random(rng, reach=3.0, shape=(5, 1)), pose.random(rng, reach=3.0, shape=(4,))
    assert pose.angle_between(A, B).shape == (5, 4)
    assert pose.offset_between(A, B, at=[1, 2, 3])[4, 2] == pytest.approx(
        pose.offset_between(A[4, 0], B[2], at=[1, 2, 3]), abs=1e-15
    )
    np.testing.assert_allclose(pose.inverse(A) @ A, np.broadcast_to(np.eye(4), (5, 1, 4, 4)), atol=1e-14)
    assert pose.from_parts(np.eye(3), np.zeros((7, 3))).shape == (7, 4, 4)
    assert pose.about(B, [1, 2, 3]).shape == (4, 4, 4)


def test_a_pose_of_nan_gives_points_of_nan():
    assert np.isnan(pose.apply(np.full((4, 4), np.nan), np.ones((2, 3)))).all()


def test_errors():
    with pytest.raises(InputError, match="4x4"):
        pose.apply(np.eye(3), [[1, 2, 3]])
    with pytest.raises(InputError, match="must broadcast"):
        pose.apply(np.stack([np.eye(4)] * 2), [[1, 2, 3]] * 3)
    with pytest.raises(InputError, match="points_source"):
        pose.apply(np.eye(4), [[1, 2]])
    with pytest.raises(InputError, match="directions_source"):
        pose.rotate(np.eye(4), [1, 2])
    with pytest.raises(InputError, match="R must hold"):
        pose.from_parts(np.eye(4), [1, 2, 3])
    with pytest.raises(InputError, match="centre"):
        pose.about(np.eye(4), [1, 2])


def test_the_room_needs_no_scipy():
    code = "import sys, dqreg.rigid; print([m for m in ('scipy', 'open3d') if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert answer.stdout.strip() == "[]"
