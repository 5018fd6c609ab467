from __future__ import annotations

import numpy as np

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth import parts


def test_the_pose_of_a_sparse_scan_is_as_good_as_its_points_allow() -> None:
    """150 points on a bracket with normal noise: the planes through sixteen of them run across its edges.

    The true pose is drawn by the test and is the start, so that the loop finds its own basin. Squared errors are in
    units of the bound by Cramer and Rao for exact normals, six on average: of 40 draws the mean is good to 0.55. Planes
    across edges that reject the points there leave 18.
    """
    part = dqreg.Mesh(*parts.bracket())
    target, sigma, errors = dqreg.prepare_target(part), 1e-3 * part.diagonal, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        scan = sample_mesh(part, 150, rng)
        assert scan.normals is not None
        T = pose.exp(np.r_[rng.normal(size=3), part.diagonal * rng.normal(size=3)])
        seen = pose.apply(pose.inverse(T), scan.points) + sigma * rng.normal(size=(150, 3))
        result = target.register(seen, T, effort="fast", search="never", verdict=False)
        error = pose.log(T @ pose.inverse(result.T_target_source))
        rows = np.hstack([np.cross(scan.points, scan.normals), scan.normals])
        errors.append(float(np.sum((rows @ error) ** 2)) / sigma**2)
    assert np.mean(errors) < 9.0
