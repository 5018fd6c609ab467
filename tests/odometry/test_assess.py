from __future__ import annotations

import numpy as np

from dqreg.odometry.assess import across_normals


def test_what_motions_move_across_the_normals_is_that_of_each_point() -> None:
    rng = np.random.default_rng(0)
    arms, normals, weights, motions = rng.normal(size=(200, 3)), rng.normal(size=(200, 3)), rng.random(200), np.eye(6)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:20] = 0.0
    motions = motions + 0.3 * rng.normal(size=(6, 6))
    for motion, found in zip(motions.T, across_normals(motions, arms, normals, weights), strict=True):
        moved = motion[3:] + np.cross(motion[:3], arms)
        across = moved - np.sum(moved * normals, axis=1)[:, None] * normals
        np.testing.assert_allclose(found, weights @ np.sum(across**2, axis=1), rtol=1e-12)
