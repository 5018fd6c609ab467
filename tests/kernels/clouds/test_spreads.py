from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.clouds.spreads import scatter_of_most


@pytest.mark.parametrize("count", [1, 3, 10, 501, 5_000])
@pytest.mark.parametrize("share", [0.5, 0.95, 1.0])
def test_the_scatter_of_most_points_leaves_the_farthest_out(count: int, share: float) -> None:
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3)) * [3.0, 2.0, 0.1] + [1e3, 0.0, -5.0]
    points[::9] *= 4.0
    away = ((points - np.median(points, axis=0)) ** 2).sum(axis=1)
    kept = points[away <= np.quantile(away, share) * (1.0 + 1e-12)]
    expected = np.cov(kept.T, bias=True).reshape(3, 3) if len(kept) > 1 else np.zeros((3, 3))
    np.testing.assert_allclose(scatter_of_most(points, share), expected, atol=1e-9 * max(np.abs(expected).max(), 1.0))
