from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.periodic import thread
from dqreg.compare.trust.task import TrustTask
from dqreg.geometry import sample_mesh
from dqreg.geometry.opening import as_geometry
from dqreg.registration.other_poses import rivals
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, load_case, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import bracket
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld
from tests.search.periodic import pegs

PITCH = 21.0
PLATE = pegs(6, 5, PITCH)
TARGET = dqreg.prepare_target(PLATE)
NOISE = 0.03
SHIPPED = Path(__file__).parents[3] / "datasets_synth"


def scan_of(middle: bool) -> np.ndarray:
    """A scan of the plate's upper side, or of nothing but pegs around its middle, in its own frame."""
    rng = np.random.default_rng(3)
    sample = sample_mesh(PLATE, 30_000, rng)
    points = sample.points[(sample.points[:, 2] > 2.9)]
    if middle:
        points = points[(np.abs(points[:, :2] - PLATE.centre[:2]) < 1.4 * PITCH).all(axis=1)]
    return points + NOISE * rng.normal(size=points.shape)


@pytest.mark.parametrize("periods", [(0, 0), (1, 0), (-1, 1), (2, 0)])
def test_a_start_some_periods_off_is_decided_by_the_points_that_tell(periods: tuple[int, int]) -> None:
    # Truth: the identity. Only the plate's ends tell the places apart.
    start = pose.from_parts(np.eye(3), [PITCH * periods[0] + 0.4, PITCH * periods[1] - 0.3, 0.2])
    result = TARGET.register(scan_of(middle=False), start, effort="fast", search="never")
    assert worst_vertex_displacement(result.T_target_source, np.eye(4), PLATE.vertices) <= NOISE
    assert result.verdict.level == "accepted"


def test_in_the_middle_of_a_lattice_the_next_period_is_named() -> None:
    result = TARGET.register(scan_of(middle=True), np.eye(4), effort="fast", search="never")
    assert "alternative_poses" in result.verdict.codes
    assert any("one period (21" in reason for reason in result.verdict.reasons)
    shifts = [other.T_target_source[:3, 3] for other in result.alternatives]
    for period in ([PITCH, 0.0, 0.0], [-PITCH, 0.0, 0.0], [0.0, PITCH, 0.0], [0.0, -PITCH, 0.0]):
        assert min(np.linalg.norm(shift - period) for shift in shifts) <= 0.01 * PITCH
    # They explain the scan as well: no gain beyond three standard errors, or a hundredth.
    assert all(abs(other.gain) <= max(3.0 * other.gain_sigma, 0.01) for other in result.alternatives)


def test_periods_are_looked_for_where_a_scan_does_not_show_the_ends_of_a_part() -> None:
    # They take a tenth of a registration to find; one period on, a scan of all of the plate would stick out of it.
    target, whole = dqreg.prepare_target(PLATE), sample_mesh(PLATE, 30_000, np.random.default_rng(4)).points
    assert target.register(whole, np.eye(4), effort="fast").alternatives == ()
    assert "near_periods" not in vars(target.indexed)
    # A hair less than the last row of pegs is no end.
    target.register(whole[whole[:, 0] < PLATE.bounds[1][0] - 0.5 * PITCH], np.eye(4), effort="fast")
    assert len(vars(target.indexed)["near_periods"])


def test_alternatives_are_saved_and_read(tmp_path) -> None:
    result = TARGET.register(scan_of(middle=True), np.eye(4), effort="fast", search="never")
    result.save(tmp_path / "result.json")
    read = dqreg.Registration.load(tmp_path / "result.json").alternatives
    assert [(a.gain, a.gain_sigma, a.words) for a in read] == [
        (a.gain, a.gain_sigma, a.words) for a in result.alternatives
    ]


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_half_a_turn_along_the_screw_of_a_thread_is_named(noise: float) -> None:
    # The middle of a threaded rod, made by the sweep's generator: any turn with its part of the pitch fits as well, but
    # for what its facets hold: 12 to 28 points of 400 to 850, measured.
    part = thread(np.random.default_rng(0))
    points = sample_mesh(part.mesh, 6_000, np.random.default_rng(1)).points
    points = points[np.abs(points[:, 2] - part.middle[2]) < 1.2 * part.cell]
    points += noise * part.mesh.diagonal * np.random.default_rng(2).normal(size=points.shape)
    result = dqreg.register(points, part.mesh, np.eye(4), effort="fast", search="never")
    assert result.verdict.level == "suspect"
    off = [worst_vertex_displacement(a.T_target_source, part.period, part.mesh.vertices) for a in result.alternatives]
    assert min(off) <= 0.01 * part.mesh.diagonal
    assert "and shifted by" in result.alternatives[int(np.argmin(off))].words


def test_what_stands_near_the_part_draws_the_pose_no_more_than_noise() -> None:
    # A shipped scene: 913 of 7,189 points are on the part, the rest on a table and other parts. The truth is that of
    # the virtual scan; Cramer and Rao's bound is 0.032 mm, and the loop alone stays 0.6 mm off.
    case = load_case(SHIPPED / "feeder_table")
    part = as_geometry(case.part, "part")
    assert isinstance(part, dqreg.Mesh)
    result = dqreg.register(case.scan, part, case.T_target_source, effort="fast", search="never")
    assert worst_vertex_displacement(result.T_target_source, case.T_target_source, part.vertices) <= 0.2
    assert result.verdict.level == "accepted"


def test_a_large_scan_of_the_part_itself_is_not_mirrored(monkeypatch) -> None:
    # Its points on faces are taken together and scatter less; beside them those near the edges are none the farther.
    part = dqreg.Mesh(*bracket())
    scanner, noise = Scanner([(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)], pixels=250), Noise(range_sigma=3e-4 * part.diagonal)
    points = scan_mesh(part.vertices, part.faces, scanner, noise, rng=np.random.default_rng(1)).points
    asked: list[object] = []
    monkeypatch.setattr(rivals, "gain_of_mirror", lambda *fit: asked.append(fit) or -np.inf)
    assert dqreg.register(points, part, "identity", effort="fast").verdict.level == "accepted"
    assert not asked


@pytest.mark.parametrize("flipped", [False, True])
def test_a_step_below_what_counts_as_symmetric_decides_where_the_noise_is_less(flipped: bool) -> None:
    # A pocket of a thousandth of the size on a corner of a block, and noise a tenth of that; the truth is the identity.
    x, y, z = np.array([0.0, 2.0, 3.0]), np.array([0.0, 1.5, 2.0]), np.array([0.0, 0.995, 1.0])
    filled = np.ones((2, 2, 2), dtype=bool)
    filled[1, 1, 1] = False
    part = dqreg.Mesh(*weld(cells([x, y, z], filled)))
    rng = np.random.default_rng(11)
    points = sample_mesh(part, 4_000, rng).points
    points += 1e-4 * part.diagonal * rng.normal(size=points.shape)
    centre = np.array([1.5, 1.0, 0.5])
    half_turn = np.diag([-1.0, -1.0, 1.0])
    start = pose.from_parts(half_turn, centre - half_turn @ centre) if flipped else np.eye(4)
    found = dqreg.register(points, part, start, effort="fast")
    assert worst_vertex_displacement(found.T_target_source, np.eye(4), part.vertices) < 1e-3 * part.diagonal
    assert found.alternatives == ()


@pytest.mark.parametrize("seed", [8069, 8086])
def test_the_mirror_image_of_a_part_that_is_far_from_its_own_is_named(seed: int) -> None:
    """Random parts of the trust sweep, scanned mirrored: two thirds of the points lie on the part at the best pose."""
    task = KINDS["mirrored"].task(seed)
    assert isinstance(task, TrustTask)
    assert "mirrored" in dqreg.register(task.source, task.target, task.start, **task.options).verdict.codes
