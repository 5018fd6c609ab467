from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.evidence.neighbour_differences import neighbour_differences


@pytest.mark.parametrize("cosine", [-2.0, 0.3, 2.0])
def test_pairs_are_those_with_like_normals(cosine: float) -> None:
    rng = np.random.default_rng(0)
    residuals, normals = rng.normal(size=50), rng.normal(size=(50, 3))
    beside = rng.integers(-3, 50, size=(50, 4))
    apart, sums = np.zeros(200), np.zeros(2)
    count = neighbour_differences(residuals, normals, beside, cosine, apart, sums)
    one, rank = np.nonzero(beside >= 0)
    two = beside[one, rank]
    same = (normals[one] * normals[two]).sum(axis=1) > cosine
    a, b = residuals[one[same]], residuals[two[same]]
    assert count == len(a)
    np.testing.assert_allclose(apart[:count], np.abs(a - b), rtol=1e-15)
    np.testing.assert_allclose(sums, [a @ b, 0.5 * (a @ a + b @ b)], rtol=1e-12, atol=1e-12)
