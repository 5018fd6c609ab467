from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import IntArray
from dqreg.kernels.evidence.ray_pixels import COUNTS, fill_pixels, rays_met
from dqreg.rigid import pose
from tests.strategies import FloatArray

PIXEL, POLE, MARGIN, BLUR = 0.21, 0.96, 0.1, 0.02


def rows() -> tuple[IntArray, IntArray]:
    heights = (np.arange(int(np.ceil(np.pi / PIXEL))) + 0.5) * PIXEL - 0.5 * np.pi
    columns = np.maximum((2.0 * np.pi / PIXEL * np.cos(heights)).astype(np.int64), 3)
    return np.cumsum(columns) - columns, columns


def pixels_about(point: FloatArray, firsts: IntArray, columns: IntArray) -> list[int] | None:
    """The pixel of a point and the eight about it; None at a pole."""
    x, y, z = point / np.linalg.norm(point)
    row, found = int((np.arcsin(z) + 0.5 * np.pi) / PIXEL), []
    for other in (row - 1, row, row + 1):
        if not 0 <= other < len(columns):
            return None
        column = int((np.arctan2(y, x) + np.pi) / (2.0 * np.pi) * columns[other])
        found += [int(firsts[other] + (column + step) % columns[other]) for step in (-1, 0, 1)]
    return found


@pytest.mark.parametrize("seed", range(4))
def test_rays_met_what_brute_force_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    firsts, columns = rows()
    arms = rng.normal(size=(4_000, 3))
    arms *= (rng.uniform(1.0, 2.0, len(arms)) / np.linalg.norm(arms, axis=1))[:, None]
    # Part of the sphere is out of view.
    arms = arms[arms[:, 0] > -0.3]
    nearest, farthest = np.full(columns.sum(), np.inf), np.zeros(columns.sum())
    at = np.zeros(len(arms), dtype=np.int64)
    fill_pixels(arms, PIXEL, firsts, columns, nearest, farthest, at)
    ranges = np.linalg.norm(arms, axis=1)
    for k in np.unique(at):
        assert (nearest[k], farthest[k]) == (ranges[at == k].min(), ranges[at == k].max())
    points, T = 1.5 * rng.normal(size=(300, 3)), np.stack([pose.random(rng, reach=0.3) for _ in range(3)])
    counts = np.zeros((len(T), COUNTS), dtype=np.int64)
    turns, shifts = T[:, :3, :3].copy(), T[:, :3, 3].copy()
    image = PIXEL, firsts, columns, nearest, farthest
    rays_met(0, len(T), points, turns, shifts, *image, MARGIN, BLUR, POLE, counts)
    for k, motion in enumerate(T):
        expected = np.zeros(COUNTS, dtype=np.int64)
        for point in pose.apply(motion, points):
            length = float(np.linalg.norm(point))
            about = pixels_about(point, firsts, columns) if abs(point[2]) < POLE * length else None
            if about is None or not np.isfinite(nearest[about]).all():
                continue
            step = MARGIN + BLUR * length
            through, behind = nearest[about].min() - length > step, length - farthest[about].max() > step
            expected[0 if through else 2 if behind else 1] += 1
        np.testing.assert_array_equal(counts[k], expected)
        assert expected.all()
