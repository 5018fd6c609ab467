from __future__ import annotations

import numpy as np

from dqreg.kernels.grid_gains import mean_gains
from dqreg.rigid import pose


def test_means_are_those_looked_up_one_by_one() -> None:
    rng = np.random.default_rng(0)
    shape = np.array([4, 5, 6])
    gains = np.append(rng.random(4 * 5 * 6), 0.25).astype(np.float32)
    points, T = rng.uniform(-2.0, 2.0, size=(30, 3)), pose.random(rng, reach=1.0, shape=(20,))
    T[:, :3, 3] += 2.5
    means = np.zeros(20)
    mean_gains(0, 8, T[:, :3, :3].copy(), T[:, :3, 3].copy(), points, shape, gains, means)
    mean_gains(8, 20, T[:, :3, :3].copy(), T[:, :3, 3].copy(), points, shape, gains, means)
    cells = np.floor(np.stack([pose.apply(each, points) for each in T])).astype(np.int64)
    inside = ((cells >= 0) & (cells < shape)).all(axis=2)
    assert 0 < inside.sum() < inside.size
    rows = np.where(inside, (cells[..., 0] * 5 + cells[..., 1]) * 6 + cells[..., 2], 120)
    np.testing.assert_allclose(means, gains[rows].astype(float).mean(axis=1), rtol=1e-14)
