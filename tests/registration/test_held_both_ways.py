"""What a few points at the rim of a plate hold: the way out, and not the way back."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
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
