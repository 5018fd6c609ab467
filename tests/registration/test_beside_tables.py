"""A small feature tells poses of a part apart beside a table as it does without."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg import Mesh, register
from dqreg._arrays import FloatArray
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import block

# But for a small notch it looks alike after half-turns.
PART = Mesh(*block(notch=3.5))
LOW, HIGH = PART.bounds


def scanned(table_points: int) -> FloatArray:
    """All of the part but its lower side, and so many points of a table beside it."""
    rng = np.random.default_rng(0)
    points = sample_mesh(PART, 3_000, rng).points
    points = points[points[:, 2] > LOW[2] + 1e-6]
    table = rng.uniform(-300.0, 300.0, (table_points, 3))
    table[:, 2] = LOW[2] - 0.02
    beside = ((table < LOW) | (table > HIGH))[:, :2].any(axis=1)
    both = rng.permutation(np.concatenate([points, table[beside]]))
    return np.asarray(both + 1e-4 * PART.diagonal * rng.normal(size=both.shape))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("table_points", [0, 60_000])
def test_a_notch_decides_between_half_turns(table_points: int, axis: int) -> None:
    half_turn = pose.about(pose.exp(np.pi * np.eye(6)[axis]), PART.centre)
    result = register(scanned(table_points), PART, half_turn, search="never", effort="fast")
    moved = pose.apply(result.T_target_source, PART.vertices) - PART.vertices
    assert np.abs(moved).max() < 0.01 * PART.diagonal
    assert result.verdict.level == "accepted", result.verdict.reasons
