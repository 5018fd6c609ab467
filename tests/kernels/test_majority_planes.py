from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.majority_planes import majority_plane_rows

TRIPLES = np.array([[0, 1, 2], [3, 9, 14], [5, 6, 11], [2, 7, 15], [1, 4, 8]])


def reaches(points: FloatArray, neighbours: IntArray, most: int, least: float = 0.5) -> FloatArray:
    found = np.zeros(len(neighbours))
    majority_plane_rows(0, len(neighbours), points, neighbours, TRIPLES, most, least, found)
    return found


def plain(points: FloatArray, most: int, least: float) -> float:
    """The plain twin: each plane alone."""
    extent, best = ((points - points.mean(axis=0)) ** 2).sum(axis=1).mean(), np.nan
    for p, q, r in points[TRIPLES]:
        normal = np.cross(q - p, r - p)
        if np.linalg.norm(normal) > least * extent:
            apart = np.sort(np.abs((points - p) @ normal) / np.linalg.norm(normal))
            best = np.fmin(best, apart[most - 1])
    return float(best)


@pytest.mark.parametrize("most", [4, 7, 16])
def test_it_is_the_least_of_all_planes(most: int) -> None:
    rng = np.random.default_rng(most)
    points = rng.normal(size=(60, 3)) * [1.0, 0.7, 0.2]
    neighbours = np.stack([rng.choice(60, 16, replace=False) for _ in range(20)])
    expected = [plain(points[rows], most, 0.5) for rows in neighbours]
    np.testing.assert_allclose(reaches(points, neighbours, most), expected, rtol=1e-9)
    assert np.isfinite(expected).any()


def test_half_of_the_points_on_another_sheet_change_nothing() -> None:
    rng = np.random.default_rng(0)
    sheet = np.column_stack([rng.uniform(size=(16, 2)), np.zeros(16)])
    sheet[[10, 11, 12, 13, 3, 5, 6, 15]] += [0.0, 0.0, 0.1]
    assert reaches(sheet, np.arange(16)[None], 8)[0] < 1e-15


def test_points_on_a_line_span_no_plane() -> None:
    assert np.isnan(reaches(np.outer(np.arange(16.0), [1.0, 2.0, 3.0]), np.arange(16)[None], 7)[0])
