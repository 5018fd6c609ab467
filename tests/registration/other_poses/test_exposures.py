"""Two exposures of a part that moved between them by a known motion, in no order."""

from __future__ import annotations

import numpy as np

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import bracket

PART = dqreg.Mesh(*bracket())
SIZE = PART.diagonal
TARGET = dqreg.prepare_target(PART)
STEP = np.concatenate([np.deg2rad(4.0) * np.array([0.6, 0.0, 0.8]), 0.05 * SIZE * np.array([0.0, 0.8, 0.6])])


def checks_of(beside: np.ndarray) -> dict[str, dqreg.trust.records.Check]:
    """The verdict on 3,000 points of the part, in its own frame, and some more."""
    rng = np.random.default_rng(0)
    points = np.concatenate([sample_mesh(PART, 3_000, rng).points, beside])
    points = rng.permutation(points + 3e-4 * SIZE * rng.normal(size=points.shape))
    result = TARGET.register(points, "identity", effort="fast", search="never")
    return {check.code: check for check in result.verdict.checks}


def test_a_second_exposure_is_told_with_its_motion() -> None:
    T = pose.about(pose.exp(STEP), PART.centre)
    second = pose.apply(T, sample_mesh(PART, 1_000, np.random.default_rng(1)).points)
    drift = checks_of(second)["drift"]
    assert not drift.passed
    # Root mean square over the points that lie beside the part, in sizes: the shift and what the rotation adds.
    assert 0.03 <= drift.value <= 0.07


def test_a_plane_beside_the_part_is_no_exposure() -> None:
    rng = np.random.default_rng(1)
    table = np.column_stack([rng.uniform(-0.6, 0.6, (2_000, 2)) * SIZE + PART.centre[:2], np.zeros(2_000)])
    table[:, 2] = PART.vertices[:, 2].min() - 0.03 * SIZE
    assert checks_of(table)["drift"].passed
