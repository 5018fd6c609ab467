"""Parts made a little off their dimensions: the pose is known, and what is off is for an inspection to tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

import dqreg
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, random_pose, scan_mesh
from dqreg.synth.parts import bracket, plate

CORNERS = [(x, y, z) for x in (1.0, -1.0) for y in (1.0, -1.0) for z in (1.0, -1.0)]
PLATE, BRACKET = dqreg.Mesh(*plate(size=(80.0, 60.0, 6.0))), dqreg.Mesh(*bracket())


def bent(off: float) -> tuple[np.ndarray, np.ndarray]:
    """The plate, cut along its length and bent: its middle is off by so much."""
    corners, faces = plate(size=(80.0, 60.0, 6.0))
    part = trimesh.Trimesh(corners, faces, process=False).subdivide_to_size(5.0)
    vertices = np.array(part.vertices)
    middle, length = vertices[:, 0].mean(), np.ptp(vertices[:, 0])
    vertices[:, 2] += off * (1.0 - (2.0 * (vertices[:, 0] - middle) / length) ** 2)
    return vertices, np.array(part.faces)


def registered(
    nominal: dqreg.Mesh, made: dqreg.Mesh, seed: int, k: float = 1.0, pixels: int = 60, **options: Any
) -> tuple[dqreg.Registration, float]:
    """From a pose near by, in a unit of k others, and how far the farthest corner is off the drawn pose, in sizes."""
    rng = np.random.default_rng(seed)
    noise = Noise(range_sigma=1e-4 * made.diagonal)
    scan = scan_mesh(made.vertices, made.faces, Scanner(CORNERS, pixels=pixels), noise, rng=rng).points
    T = random_pose(rng, made.diagonal, made.centre)
    start = disturbance(rng, np.deg2rad(1.0), 0.005 * made.diagonal, made.centre) @ T
    for matrix in (T, start):
        matrix[:3, 3] *= k
    nominal = dqreg.Mesh(k * nominal.vertices, nominal.faces)
    options = {"effort": "fast", "keep_inputs": False} | options
    result = dqreg.register(pose.apply(pose.inverse(T), k * scan), nominal, start, **options)
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
    result, error = registered(BRACKET, dqreg.Mesh(*bracket(length=120.4)), 40_801, pixels=100)
    assert result.verdict.level == "accepted"
    assert error <= 2e-4


def test_a_plate_of_another_thickness_is_none_of_these() -> None:
    result, _ = registered(PLATE, dqreg.Mesh(*plate(size=(80.0, 60.0, 6.6))), 40_802)
    assert "stretched" in result.verdict.codes


@pytest.mark.parametrize(
    ("nominal", "made", "off"),
    [(PLATE, plate(size=(80.0, 60.0, 6.6)), 0.6), (PLATE, bent(0.5), 0.6), (BRACKET, bracket(length=121.5), 1.5)],
)
def test_what_a_part_is_expected_to_be_off_is_no_doubt(nominal: dqreg.Mesh, made: Any, off: float) -> None:
    part = dqreg.Mesh(*made)
    without, _ = registered(nominal, part, 40_803, search="never")
    assert without.verdict.level == "suspect"
    result, error = registered(nominal, part, 40_803, expected_deviation=off)
    assert result.verdict.level == "accepted", result.verdict.reasons
    assert all(check.passed is not False for check in result.verdict.checks)
    # Where it stands within its own difference is a matter of datums.
    assert error <= off / nominal.diagonal
    # The limits are multiplied, the pose is the same.
    np.testing.assert_array_equal(result.T_target_source, without.T_target_source)


@pytest.mark.parametrize("expected", [0.05, 0.2])
def test_what_is_off_by_more_than_is_expected_is_one(expected: float) -> None:
    # 0.6 too thick, of which best fits lay half on either side.
    made = dqreg.Mesh(*plate(size=(80.0, 60.0, 6.6)))
    result, _ = registered(PLATE, made, 40_804, expected_deviation=expected, search="never")
    assert result.verdict.level == "suspect"


def test_the_expected_deviation_is_a_length_of_the_target() -> None:
    made = dqreg.Mesh(*plate(size=(80.0, 60.0, 6.6)))
    in_mm, in_m = (registered(PLATE, made, 40_805, k, expected_deviation=0.6 * k)[0] for k in (1.0, 1e-3))
    assert in_mm.verdict.codes == in_m.verdict.codes == ("accepted",)
    assert in_m.settings["expected_deviation"] == 0.6 * 1e-3


def test_a_wrong_pose_stays_one_where_a_part_may_be_off() -> None:
    # The bracket from a pose that is turned by 180 degrees and held there: faces lie apart by much more.
    rng = np.random.default_rng(40_806)
    scan = scan_mesh(BRACKET.vertices, BRACKET.faces, Scanner(CORNERS, pixels=60), Noise(), rng=rng).points
    turned = pose.exp([0.0, 0.0, np.pi, 0.0, 0.0, 0.0])
    turned[:3, 3] = BRACKET.centre - turned[:3, :3] @ BRACKET.centre
    found = dqreg.register(scan, BRACKET, turned, search="never", expected_deviation=0.01 * BRACKET.diagonal)
    assert found.verdict.level != "accepted"


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf, "1 mm", [1.0]])
def test_an_expected_deviation_is_a_length(wrong: Any) -> None:
    with pytest.raises(dqreg.InputError, match="expected_deviation must be a"):
        dqreg.register(PLATE, PLATE, "identity", expected_deviation=wrong)


def test_a_strain_counts_at_the_points_that_its_fit_leaves_out() -> None:
    # A bracket one in a hundred longer: its ends, a tenth of the scan, are outliers to the fit, and it was accepted.
    result, _ = registered(BRACKET, dqreg.Mesh(*bracket(length=121.5)), 40_807)
    assert "stretched" in result.verdict.codes
