from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.voxel_rows import first_of_voxels


@pytest.mark.parametrize("count", [0, 1, 500, 20_000])
def test_the_first_row_of_each_voxel_is_found(count: int) -> None:
    # Oracle: distinct cells, by sorting. Many cells of either sign, with many points in some.
    points = np.random.default_rng(count).normal(size=(count, 3)) * [8.0, 5.0, 0.4]
    _, rows = np.unique(np.floor(points / 0.3), axis=0, return_index=True)
    np.testing.assert_array_equal(first_of_voxels(points, 0.3), np.sort(rows))


def test_it_leaves_what_kiss_icp_leaves() -> None:
    # Oracle: KISS-ICP's downsampling, in an order of its own.
    voxels = pytest.importorskip("kiss_icp.voxelization")
    points = np.random.default_rng(3).normal(size=(5000, 3)) * 4.0
    found, known = points[first_of_voxels(points, 0.5)], np.array(voxels.voxel_down_sample(points, 0.5))
    assert len(found) == len(known)
    np.testing.assert_array_equal(found[np.lexsort(found.T)], known[np.lexsort(known.T)])
