"""Parts made a little off their dimensions: the pose is known, and what is off is for an inspection to tell."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, random_pose, scan_mesh
from dqreg.synth.parts import bracket, plate

CORNERS = [(x, y, z) for x in (1.0, -1.0) for y in (1.0, -1.0) for z in (1.0, -1.0)]
PLATE, BRACKET = dqreg.Mesh(*plate(size=(80.0, 60.0, 6.0))), dqreg.Mesh(*bracket())


def registered(nominal: dqreg.Mesh, made: dqreg.Mesh, seed: int) -> tuple[dqreg.Registration, float]:
    """From a pose near by, and how far the farthest corner is off the drawn pose, in sizes."""
    rng = np.random.default_rng(seed)
    noise = Noise(range_sigma=1e-4 * made.diagonal)
    scan = scan_mesh(made.vertices, made.faces, Scanner(CORNERS, pixels=100), noise, rng=rng).points
    T = random_pose(rng, made.diagonal, made.centre)
    start = disturbance(rng, np.deg2rad(1.0), 0.005 * made.diagonal, made.centre) @ T
    result = dqreg.register(pose.apply(pose.inverse(T), scan), nominal, start, effort="fast", keep_inputs=False)
    apart = pose.apply(result.T_target_source @ pose.inverse(T), nominal.vertices) - nominal.vertices
    return result, float(np.linalg.norm(apart, axis=1).max()) / nominal.diagonal


@pytest.mark.parametrize("off", [-0.1, 0.03])
def test_a_plate_made_too_thick_or_too_thin_is_that_plate(off: float) -> None:
    # Strained by 0.3 to 1.7 % across: it was taken for another part, its pose for right with a probability of 0.01.
    result, error = registered(PLATE, dqreg.Mesh(*plate(size=(80.0, 60.0, 6.0 + off))), 40_800)
    assert result.verdict.level == "accepted"
    # Where the plate stands within its own difference is a matter of datums.
    assert error <= abs(off) / PLATE.diagonal + 1e-4


def test_a_bracket_made_too_long_is_that_bracket() -> None:
    result, error = registered(BRACKET, dqreg.Mesh(*bracket(length=120.4)), 40_801)
    assert result.verdict.level == "accepted"
    assert error <= 2e-4


def test_a_plate_of_another_thickness_is_none_of_these() -> None:
    result, _ = registered(PLATE, dqreg.Mesh(*plate(size=(80.0, 60.0, 6.6))), 40_802)
    assert "stretched" in result.verdict.codes
