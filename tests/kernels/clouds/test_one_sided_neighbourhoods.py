from __future__ import annotations

import numpy as np

from dqreg.kernels.clouds.one_sided_neighbourhoods import off_centre_rows


def test_places_are_those_whose_mean_neighbour_stands_aside() -> None:
    # Oracle: the same in whole arrays.
    rng = np.random.default_rng(0)
    cloud, around = rng.normal(size=(200, 3)), rng.integers(0, 200, size=(300, 8))
    at, normals = 0.5 * rng.normal(size=(300, 3)), rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:20] = 0.0
    found, outwards = np.zeros(300, dtype=bool), np.zeros((300, 3))
    for first, last in ((0, 100), (100, 300)):
        off_centre_rows(first, last, cloud, around, at, normals, 0.42, found, outwards)
    offsets = cloud[around] - at[:, None]
    mean = offsets.mean(axis=1)
    mean -= np.einsum("ij,ij->i", mean, normals)[:, None] * normals
    off, spread = np.linalg.norm(mean, axis=1), np.sqrt((offsets**2).sum(axis=2).mean(axis=1))
    expected = (off > 0.42 * spread) & normals.any(axis=1)
    assert 20 < expected.sum() < 280
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(outwards, -mean / off[:, None], atol=1e-12)
