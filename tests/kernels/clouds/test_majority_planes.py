from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.clouds.majority_planes import majority_plane_rows

TRIPLES = np.array([[0, 1, 2], [3, 9, 14], [5, 6, 11], [2, 7, 15], [1, 4, 8]])


UP = np.array([0.0, 0.0, 1.0])


def reaches(
    points: FloatArray, neighbours: IntArray, most: int, least: float = 0.5, upright: float = 0.0
) -> FloatArray:
    found, normals = np.zeros(len(neighbours)), np.tile(UP, (len(neighbours), 1))
    majority_plane_rows(0, len(neighbours), points, neighbours, normals, TRIPLES, most, least, upright, found)
    return found


def plain(points: FloatArray, most: int, least: float, upright: float) -> float:
    """The plain twin: each plane alone."""
    extent, best = ((points - points.mean(axis=0)) ** 2).sum(axis=1).mean(), np.nan
    for p, q, r in points[TRIPLES]:
        normal = np.cross(q - p, r - p)
        if np.linalg.norm(normal) > least * extent and abs(normal @ UP) >= upright * np.linalg.norm(normal):
            apart = np.sort(np.abs((points - p) @ normal) / np.linalg.norm(normal))
            best = np.fmin(best, apart[most - 1])
    return float(best)


@pytest.mark.parametrize(("most", "upright"), [(4, 0.0), (7, 0.9), (16, 0.5)])
def test_it_is_the_least_of_all_planes(most: int, upright: float) -> None:
    rng = np.random.default_rng(most)
    points = rng.normal(size=(60, 3)) * [1.0, 0.7, 0.2]
    neighbours = np.stack([rng.choice(60, 16, replace=False) for _ in range(20)])
    expected = [plain(points[rows], most, 0.5, upright) for rows in neighbours]
    np.testing.assert_allclose(reaches(points, neighbours, most, upright=upright), expected, rtol=1e-9)
    assert np.isfinite(expected).any()


def test_half_of_the_points_on_another_sheet_change_nothing() -> None:
    rng = np.random.default_rng(0)
    sheet = np.column_stack([rng.uniform(size=(16, 2)), np.zeros(16)])
    sheet[[10, 11, 12, 13, 3, 5, 6, 15]] += [0.0, 0.0, 0.1]
    assert reaches(sheet, np.arange(16)[None], 8)[0] < 1e-15


def test_points_on_a_line_span_no_plane() -> None:
    assert np.isnan(reaches(np.outer(np.arange(16.0), [1.0, 2.0, 3.0]), np.arange(16)[None], 7)[0])


def test_the_plane_of_a_ring_round_a_corner_is_none_of_the_faces() -> None:
    # Two rings of a laser over a ridge, each in an upright plane exactly; along their beams, here upwards, is noise.
    rng = np.random.default_rng(1)
    x = np.tile([-1.0, 0.1, 1.0, -0.7, 0.7, -0.4, 0.4, -0.1], 2)
    rings = np.column_stack([x, np.repeat([0.0, 2.0], 8), -np.abs(x) + 0.05 * rng.normal(size=16)])
    assert reaches(rings, np.arange(16)[None], 7, least=0.1)[0] < 1e-15
    assert reaches(rings, np.arange(16)[None], 7, least=0.1, upright=0.5)[0] > 0.02
