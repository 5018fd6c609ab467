from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.truth import disturbance, random_pose, rms_vertex_displacement, worst_vertex_displacement

seeds = st.integers(0, 2**32 - 1)
centres = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


@settings(deadline=None, max_examples=50)
@given(seeds, st.floats(0.0, np.pi), st.floats(0.0, 100.0), centres)
def test_disturbance_has_the_asked_angle_and_offset(seed, angle_rad, offset, centre):
    T = disturbance(np.random.default_rng(seed), angle_rad, offset, centre)
    # SciPy measures the angle; near pi it is good to the root of the rounding error.
    assert Rotation.from_matrix(T[:3, :3]).magnitude() == pytest.approx(angle_rad, abs=1e-7)
    assert np.linalg.norm(pose.apply(T, centre) - centre) == pytest.approx(offset, abs=1e-11)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-7, np.pi])
def test_disturbance_at_the_edges(angle_rad):
    T = disturbance(np.random.default_rng(0), angle_rad, 0.0, [1e6, 0.0, 0.0])
    turned = np.linalg.norm(T[:3, :3] - np.eye(3)) / np.sqrt(8)  # = sin(angle / 2)
    assert turned == pytest.approx(np.sin(angle_rad / 2), rel=1e-8, abs=1e-16)
    np.testing.assert_allclose(pose.apply(T, [1e6, 0.0, 0.0]), [1e6, 0.0, 0.0], atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(seeds, centres)
def test_random_pose_moves_the_centre_by_the_offset(seed, centre):
    T = random_pose(np.random.default_rng(seed), 7.0, centre)
    assert np.linalg.norm(pose.apply(T, centre) - centre) == pytest.approx(7.0, abs=1e-11)


def test_random_pose_favours_no_direction():
    rng = np.random.default_rng(0)
    mean = np.mean([random_pose(rng, 0.0, np.zeros(3))[:3, :3] for _ in range(2000)], axis=0)
    # Each entry of a uniform rotation has mean 0 and variance 1/3.
    assert np.abs(mean).max() < 5 / np.sqrt(3 * 2000)


def test_same_seed_same_motion():
    one, two = (disturbance(np.random.default_rng(4), 0.3, 2.0, [1, 2, 3]) for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_displacements_agree_with_moving_the_vertices():
    rng = np.random.default_rng(1)
    T, truth = pose.random(rng, reach=10.0), pose.random(rng, reach=10.0)
    vertices = rng.normal(size=(40, 3))
    # Where a perfect scan has the vertices, and where the pose puts them from there.
    scanned = pose.apply(pose.inverse(truth), vertices)
    apart = np.linalg.norm(pose.apply(T, scanned) - vertices, axis=1)
    assert worst_vertex_displacement(T, truth, vertices) == pytest.approx(apart.max(), rel=1e-12)
    assert rms_vertex_displacement(T, truth, vertices) == pytest.approx(np.sqrt((apart**2).mean()), rel=1e-12)
    assert worst_vertex_displacement(truth, truth, vertices) < 1e-14


def test_bad_input_is_named():
    with pytest.raises(InputError, match="centre"):
        disturbance(np.random.default_rng(0), 0.1, 0.0, [1.0, 2.0])
    with pytest.raises(InputError, match="vertices"):
        worst_vertex_displacement(np.eye(4), np.eye(4), np.zeros((0, 3)))
    with pytest.raises(InputError, match="T_truth"):
        rms_vertex_displacement(np.eye(4), 2.0 * np.eye(4), [[0.0, 0.0, 0.0]])
