from __future__ import annotations

import numpy as np

from dqreg.kernels.pair_keys import pair_keys


def test_keys_are_bins_of_length_and_of_three_angles() -> None:
    # Oracle: the arc cosines themselves.
    rng = np.random.default_rng(0)
    points, directions = rng.uniform(-0.5, 0.5, size=(80, 3)), rng.normal(size=(80, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    i, j = rng.integers(0, 80, size=(2, 3_000))
    keys, limits = np.zeros(3_000, dtype=np.int64), np.array([0.2, 0.9, 0.95])
    for first, last in ((0, 1_000), (1_000, 3_000)):
        pair_keys(first, last, points, directions, i, j, 0.05, limits, np.cos(0.2 * np.arange(1.0, 8.0)), keys)
    along = points[j] - points[i]
    length = np.linalg.norm(along, axis=1)
    along /= np.maximum(length, 1e-9)[:, None]
    pairs = ((directions[i], along), (directions[j], along), (directions[i], directions[j]))
    cosines = np.array([np.abs(np.einsum("ij,ij->i", a, b)) for a, b in pairs]).clip(max=1.0)
    usable = (length > 0.2) & (length < 0.9) & (cosines[:2].min(axis=0) < 0.95)
    one, other, between = (np.arccos(cosines) / 0.2).astype(int)
    expected = (length / 0.05).astype(int) * 512 + one * 64 + other * 8 + between
    assert 0 < usable.sum() < 3_000
    np.testing.assert_array_equal(keys, np.where(usable, expected, -1))
