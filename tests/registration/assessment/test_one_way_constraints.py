"""What a few points at the rim of a plate hold: the way out, and not the way back."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.synth.parts import box

SIZE = (26.0, 39.0, 1.6)
NOISE_DIAGONALS = 5e-3


@pytest.mark.parametrize("way", [(0.8, 1.2), (-0.8, 1.2), (0.8, -1.2), (-0.8, -1.2)])
def test_a_scan_within_a_face_that_slid_to_the_rims_may_slide_back(way: tuple[float, float]) -> None:
    plate, rng = dqreg.Mesh(*box(SIZE)), np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.47, 0.47, (6_000, 2)) * SIZE[:2], np.full(6_000, 0.5 * SIZE[2])])
    points += rng.normal(scale=NOISE_DIAGONALS * plate.diagonal, size=points.shape)
    start = np.eye(4)
    start[:2, 3] = way
    result = dqreg.register(points, plate, start, verdict=False)
    off = result.T_target_source[:2, 3]
    sigmas = np.sqrt(np.diag(result.covariance)[3:5])
    # Nothing is said of what is free; what is held lies where it is said to.
    assert np.all(np.isnan(sigmas) | (np.abs(off) < 5.0 * sigmas)), (off, sigmas)


def test_outliers_that_lie_on_the_sides_by_chance_hold_nothing() -> None:
    # Of all displacements the steps found the one with most of them: the plate lay seven standard deviations off.
    sides, rng = np.array([32.4, 31.9, 2.0]), np.random.default_rng(3)
    plate = dqreg.Mesh(*box(tuple(sides)))
    points = np.column_stack([rng.uniform(-0.25, 0.25, (2_400, 2)) * sides[:2], np.full(2_400, 0.5 * sides[2])])
    points += rng.normal(scale=1e-3 * plate.diagonal, size=points.shape)
    points = np.concatenate([points, rng.uniform(-0.6, 0.6, (250, 3)) * sides])[rng.permutation(2_650)]
    result = dqreg.register(points, plate, pose.exp([0.0, 0.0, -0.112, 1.76, -1.99, 0.0]), search="never")
    T = result.T_target_source
    off = np.array([np.arctan2(T[1, 0], T[0, 0]), *T[:2, 3]])
    sigmas = np.sqrt(np.diag(result.covariance)[[2, 3, 4]])
    assert np.all(np.isnan(sigmas) | (np.abs(off) < 5.0 * sigmas)), (off, sigmas)
