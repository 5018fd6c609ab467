from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.clouds.lined_runs import lined_runs

LINE = 0.15


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(13, 40))
def test_lines_and_axes_are_those_of_numpy(seed: int, count: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    points, order = rng.normal(size=(60, 3)) * 10.0 ** rng.uniform(-1.0, 0.0, 3), rng.permutation(60)
    begins = rng.integers(0, 60 - length + 1, 30)
    lined, axes, sums = np.zeros(30, dtype=bool), np.zeros((30, 2, 3)), np.zeros((30, 2))
    lined_runs(0, 30, points, order, begins, length, count, LINE, lined, axes, sums)
    for begin, found, both, least in zip(begins, lined, axes, sums, strict=True):
        run = np.delete(points[order[begin : begin + length]], length // 2, axis=0)
        apart = np.linalg.norm(run - points[order[begin + length // 2]], axis=1)
        near = run[np.argsort(apart)[:count]]
        values, vectors = np.linalg.eigh(np.cov(near.T))
        np.testing.assert_allclose(least, (count - 1) * values[:2], rtol=1e-6, atol=1e-9)
        if abs(values[1] - LINE * values[2]) > 1e-9:
            assert found == (values[1] <= LINE * values[2])
        if count > 3:
            np.testing.assert_allclose(np.abs(np.sum(both.T * vectors[:, [0, 2]], axis=0)), 1.0, rtol=1e-6)


def test_copies_have_no_axis() -> None:
    lined, axes, sums = np.ones(1, dtype=bool), np.zeros((1, 2, 3)), np.zeros((1, 2))
    lined_runs(0, 1, np.ones((9, 3)), np.arange(9), np.zeros(1, dtype=np.int64), 9, 4, LINE, lined, axes, sums)
    assert np.isnan(axes).all()
