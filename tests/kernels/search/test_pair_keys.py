from __future__ import annotations

import numpy as np

from dqreg.kernels.search.pair_keys import all_pair_keys, key_starts, order_of_keys, pair_keys


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


def test_all_pairs_stand_in_the_order_of_their_keys() -> None:
    # Oracle: the keys of single pairs, and a stable sort. Of two equal keys that of the lower row comes first.
    rng = np.random.default_rng(1)
    points, directions = rng.uniform(-0.5, 0.5, size=(60, 3)), rng.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    bins = 0.05, np.array([0.2, 0.9, 0.95]), np.cos(0.2 * np.arange(1.0, 8.0))
    i, j = map(np.ascontiguousarray, np.nonzero(~np.eye(60, dtype=bool)))
    one_by_one, keys = np.zeros(len(i), dtype=np.int64), np.zeros((60, 60), dtype=np.int32)
    pair_keys(0, len(i), points, directions, i, j, *bins, one_by_one)
    for first, last in ((20, 60), (0, 20)):
        all_pair_keys(first, last, points, directions, *bins, keys)
    np.testing.assert_array_equal(keys[i, j], one_by_one)
    assert (np.diag(keys) == -1).all()
    order = np.argsort(one_by_one, kind="stable")
    order = order[np.count_nonzero(one_by_one < 0) :]
    starts = np.searchsorted(one_by_one[order], np.arange(18 * 512 + 1))
    found, rows, columns = np.zeros_like(starts), *np.zeros((2, len(order)), dtype=np.int32)
    key_starts(keys, found)
    np.testing.assert_array_equal(found, starts)
    order_of_keys(keys, starts.copy(), rows, columns)
    assert 0 < len(order) < len(i)
    np.testing.assert_array_equal(np.stack([rows, columns]), np.stack([i[order], j[order]]))
