from __future__ import annotations

import numpy as np

from dqreg.kernels.clouds.fitted_normals import normal_variances, rough_rows


def test_variances_of_normals_are_known_where_their_planes_are() -> None:
    residuals, levers = np.array([2.0, 0.0, 1.0, 0.0, np.nan, np.nan]), np.array([0.5, 0.5, 0.0, 0.0, 0.5, 0.0])
    variances = np.zeros(6)
    normal_variances(residuals, levers, 16.0, variances)
    assert variances.tolist() == [0.5, 0.0, 1.0, 0.0, 0.0, 0.0]


def test_rough_planes_are_those_that_leave_more_than_a_share_of_their_length() -> None:
    rng = np.random.default_rng(0)
    residuals, levers = rng.uniform(size=200), np.where(rng.uniform(size=200) < 0.2, 0.0, rng.uniform(size=200))
    residuals[::7] = np.nan
    rows = np.zeros(200, dtype=np.int64)
    count, known = rough_rows(residuals, levers, 0.45, rows)
    assert known == np.count_nonzero(levers)
    expected = np.flatnonzero((levers > 0.0) & (residuals > 0.45 * np.sqrt(levers)))
    np.testing.assert_array_equal(rows[:count], expected)
