from __future__ import annotations

import numpy as np
import pytest

from dqreg.rigid import pose, quaternion
from dqreg.rigid.rotations import about_axis, angle_of, axis_of, evenly_spread


@pytest.mark.parametrize("angle", [1e-8, 0.3, 2.0, np.pi])
def test_a_rotation_has_its_axis_and_angle(angle):
    # Oracle: the exponential of the rotation vector.
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(10, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes *= np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    R = about_axis(axes, np.full(10, angle))
    np.testing.assert_allclose(R, pose.exp(np.c_[angle * axes, np.zeros((10, 3))])[:, :3, :3], atol=1e-15)
    np.testing.assert_array_equal(R[0], about_axis(axes[0], angle))
    for each, axis in zip(R, axes, strict=True):
        # Near a half-turn the chord is flat: the angle is good to the root of rounding.
        assert angle_of(each) == pytest.approx(angle, rel=1e-7)
        if angle > 0.1:
            np.testing.assert_allclose(axis_of(each), axis, atol=1e-14)


def test_rotations_spread_evenly():
    q = evenly_spread(2_000)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-14)
    rotations = quaternion.to_matrix(q)
    # No rotation is far from all of them: 2,000 balls of 15 degrees would fill the space of rotations thrice.
    rng = np.random.default_rng(0)
    for _ in range(50):
        R = pose.random(rng)[:3, :3]
        assert min(angle_of(R @ other.T) for other in rotations) < np.deg2rad(20.0)
