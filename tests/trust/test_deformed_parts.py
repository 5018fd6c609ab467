"""A part that is deformed at one place has a pose that can be trusted; a wrong pose of it has none."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg import Mesh, Registration, register
from dqreg._arrays import FloatArray
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import block

PART = Mesh(*block())
LENGTH, NOISE = float(np.ptp(PART.vertices[:, 0])), 1e-4
END = float(PART.vertices[:, 0].max())


def bent(sagitta: float, seed: int) -> FloatArray:
    """Points of the part whose last two fifths bend upwards, by that share of its length at the end."""
    rng = np.random.default_rng(seed)
    points = rng.permutation(sample_mesh(PART, 6000, rng).points)
    along = np.maximum(points[:, 0] - (END - 0.4 * LENGTH), 0.0) / (0.4 * LENGTH)
    up = sagitta * LENGTH * along**2
    return np.asarray(points + np.outer(up, [0.0, 0.0, 1.0]) + NOISE * LENGTH * rng.normal(size=points.shape))


def registered(sagitta: float, seed: int, T_off: FloatArray | None = None) -> Registration:
    start = np.eye(4) if T_off is None else T_off
    return register(bent(sagitta, seed), PART, start, search="doubt" if T_off is None else "never")


def error(result: Registration) -> float:
    """Largest displacement of the part, of its length."""
    moved = pose.apply(result.T_target_source, PART.vertices)
    return float(np.linalg.norm(moved - PART.vertices, axis=1).max() / LENGTH)


@pytest.mark.parametrize("sagitta", [*(pytest.param(x, marks=pytest.mark.soak) for x in (0.002, 0.004)), 0.006])
def test_repeated_scans_of_a_bent_end_are_trusted_each_time(sagitta: float) -> None:
    for seed in range(3):
        result = registered(sagitta, seed)
        assert result.verdict.level == "accepted", result.verdict.reasons
        assert error(result) < sagitta


def turned(axis: int) -> FloatArray:
    return pose.about(pose.exp(np.pi * np.eye(6)[axis]), PART.centre)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turned_over_it_goes_back_to_the_notch(axis: int) -> None:
    # Of a block with one notch every half-turn fits but for the notch: flips are as narrow as the pose that they are
    # compared with, else the bend draws all of them aside and the first pose wins.
    assert error(registered(0.004, 0, turned(axis))) < 0.004


@pytest.mark.parametrize("sagitta", [0.002, pytest.param(0.004, marks=pytest.mark.soak), 0.006])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_pose_that_is_held_a_little_off_is_not_trusted(sagitta: float, seed: int) -> None:
    # Locked where it is, at a hundredth of the length beside its place along one axis.
    T_off = np.eye(4)
    T_off[seed, 3] = 0.01 * LENGTH
    result = register(bent(sagitta, seed), PART, T_off, dof="rz", search="never")
    assert error(result) > 0.008
    assert result.verdict.level != "accepted"
