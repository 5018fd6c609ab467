"""The nearest rotation: of all rotations the one that departs least from a matrix."""

import numpy as np

from dqreg._rotations import nearest_rotation
from dqreg.rigid import pose, single_pose


def test_none_is_nearer_and_a_mirror_image_gets_a_rotation_too() -> None:
    rng = np.random.default_rng(20_165)
    given = rng.normal(size=(40, 3, 3))  # About half of them mirror.
    found = nearest_rotation(given)
    np.testing.assert_allclose(np.swapaxes(found, 1, 2) @ found, np.tile(np.eye(3), (40, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-14)
    others = pose.random(rng, reach=1.0, shape=(500,))[:, :3, :3]
    nearest = np.linalg.norm(given - found, axis=(1, 2))
    rest = np.linalg.norm(given[:, None] - others, axis=(2, 3)).min(axis=1)
    assert (nearest <= rest).all()
    for matrix, rotation in zip(given, found, strict=True):
        np.testing.assert_array_equal(nearest_rotation(matrix), rotation)


def test_a_pose_of_many_products_is_made_rigid_by_its_series_as_by_the_nearest_rotation() -> None:
    rng = np.random.default_rng(20_166)
    for size in (1e-12, 1e-10, 1e-6):
        T = pose.random(rng, reach=2.0)
        T[:3, :3] += size * rng.normal(size=(3, 3))
        found = single_pose.orthonormal(T)
        np.testing.assert_allclose(found[:3, :3], nearest_rotation(T[:3, :3]), atol=1e-15)
        np.testing.assert_array_equal(found[:3, 3], T[:3, 3])
