from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.search.many_poses import distinct_rows, log_likelihoods, mean_gains, poses_within
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


def test_poses_are_within_a_limit_where_no_point_is_farther_off() -> None:
    rng = np.random.default_rng(1)
    shape = np.array([7, 8, 9])
    distances = rng.random(7 * 8 * 9).astype(np.float32)
    points, T = rng.uniform(-1.0, 1.0, size=(3, 3)), pose.random(rng, reach=3.0, shape=(400,))
    T[:, :3, 3] += 4.0
    within = np.zeros(400, dtype=bool)
    asked = T[:, :3, :3].copy(), T[:, :3, 3].copy(), points, shape, distances, 0.8
    for first, last in ((0, 150), (150, 400)):
        poses_within(first, last, *asked, within)
    cells = np.floor(np.stack([pose.apply(each, points) for each in T])).astype(np.int64)
    inside = ((cells >= 0) & (cells < shape)).all(axis=2)
    at = np.where(inside, (cells[..., 0] * 8 + cells[..., 1]) * 9 + cells[..., 2], 0)
    expected = (inside & (distances[at] < 0.8)).all(axis=1)
    assert 0 < inside.all(axis=1).sum() < 400
    assert 0 < expected.sum() < inside.all(axis=1).sum()
    np.testing.assert_array_equal(within, expected)


def plain_distinct(T: np.ndarray, chord: float, offset: float, most: int) -> list[int]:
    """Rows one after the other, each compared with all that are kept."""
    kept: list[int] = []
    for k in range(len(T)):
        turned = [np.linalg.norm(T[k, :3, :3] - T[j, :3, :3]) for j in kept]
        apart = [np.linalg.norm(T[k, :3, 3] - T[j, :3, 3]) for j in kept]
        same = any(a < chord and b < offset for a, b in zip(turned, apart, strict=True))
        if not same and len(kept) < most:
            kept.append(k)
    return kept


@pytest.mark.parametrize("most", [0, 1, 7, 500])
def test_distinct_poses_are_those_compared_one_by_one(most: int) -> None:
    rng = np.random.default_rng(most)
    centres = pose.random(rng, reach=1.0, shape=(12,))
    T = centres[rng.integers(0, 12, size=200)] @ pose.exp(0.2 * rng.normal(size=(200, 6)))
    found = distinct_rows(T[:, :3, :3].copy(), T[:, :3, 3].copy(), 0.5, 0.4, most)
    assert found.tolist() == plain_distinct(T, 0.5, 0.4, most)


def test_likelihoods_are_those_of_the_plain_rounds() -> None:
    rng = np.random.default_rng(0)
    densities, outlier, share = rng.exponential(size=(3, 50)) * (rng.random((3, 50)) < 0.7), 0.3, np.full((3, 1), 0.5)
    found = densities.copy()
    log_likelihoods(0, 2, found, outlier, 0.5, 1e-3, 20)
    log_likelihoods(2, 3, found, outlier, 0.5, 1e-3, 20)
    for _ in range(20):
        weights = share * densities / (share * densities + (1.0 - share) * outlier)
        share = np.clip(weights.mean(axis=1, keepdims=True), 1e-3, 1.0 - 1e-3)
    np.testing.assert_allclose(found, np.log(share * densities + (1.0 - share) * outlier), rtol=1e-12)
