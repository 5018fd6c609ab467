"""Depth images against NumPy, row by row."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from dqreg.kernels.evidence.depth_pixels import count_before, count_behind, directions_from, fill_nearest, least_around

PIXEL, MARGIN, STEP = 0.05, 0.1, 1.5


def plain(points: np.ndarray, axes: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = axes @ (points - eye).T
    ranges = np.linalg.norm(points - eye, axis=1)
    return np.stack([np.arctan2(x, z), np.arcsin(y / ranges)]), ranges


@pytest.fixture
def seen():
    rng = np.random.default_rng(5)

    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0].copy()
    return rng.normal(size=(3000, 3)), axes, np.array([0.1, -0.2, 0.3]), rng


def test_pixels_hold_the_nearest_range_and_what_is_before_it_is_counted(seen) -> None:
    points, axes, eye, rng = seen
    places, ranges = np.zeros((2, len(points))), np.zeros(len(points))
    directions_from(0, len(points), points, axes, eye, places, ranges)
    expected = plain(points, axes, eye)
    np.testing.assert_allclose(places, expected[0], atol=1e-12)
    np.testing.assert_allclose(ranges, expected[1], rtol=1e-14)
    low = places.min(axis=1) - 1.5 * PIXEL
    height, width = ((places.max(axis=1) - low) / PIXEL).astype(np.int64) + 3
    rows, columns = ((places - low[:, None]) / PIXEL).astype(np.int64)
    image, at = np.full((height, width), np.inf), np.zeros(len(points), dtype=np.int64)
    fill_nearest(places, ranges, low, PIXEL, image, at)
    nearest = np.full(height * width, np.inf)
    np.minimum.at(nearest, rows * width + columns, ranges)
    np.testing.assert_array_equal(at, rows * width + columns)
    np.testing.assert_array_equal(image, nearest.reshape(height, width))
    behind = np.count_nonzero(ranges > 1.2 * nearest[at])
    assert count_behind(ranges, image, at, 1.2) == behind > 0
    least_around(image, around := np.zeros(image.shape))
    np.testing.assert_array_equal(around, ndimage.minimum_filter(image, 3))
    # Points about the same place, of which some lie where nothing was seen, before or behind.
    others = points + rng.normal(0.0, 0.3, points.shape)
    there, away = plain(others, axes, eye)
    i, j = np.floor((there - low[:, None]) / PIXEL).astype(np.int64)
    inside = (i >= 0) & (i < height) & (j >= 0) & (j < width)
    inside[inside] = np.isfinite(image)[i[inside], j[inside]]
    nearer, limit = around[i[inside], j[inside]] - away[inside], MARGIN + STEP * PIXEL * away[inside]
    counts = np.zeros(2, dtype=np.int64)
    count_before(others, axes, eye, low, PIXEL, around, np.isfinite(image), MARGIN, STEP, counts)
    assert counts.tolist() == [np.count_nonzero(nearer > limit), np.count_nonzero(np.abs(nearer) <= limit)]
    assert 0 < counts[0] < inside.sum()
    assert inside.sum() < len(points)
