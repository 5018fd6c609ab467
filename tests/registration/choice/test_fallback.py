from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.registration.choice.fallback import is_doubtful
from dqreg.registration.choice.kept_start import meant_copy
from dqreg.registration.fit.fit import coarse_to_fine
from dqreg.registration.other_poses.rivals import best_seen
from dqreg.registration.other_poses.same_poses import but_slid
from dqreg.rigid import pose, twist
from dqreg.synth import Noise, Scanner, disturbance, load_case, random_pose, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import box, bracket, flange
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.registration.scenes import problem_of

PART = dqreg.Mesh(*bracket())
SIZE = PART.diagonal
SCAN = scan_mesh(
    PART.vertices,
    PART.faces,
    Scanner([(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)], pixels=150),
    Noise(range_sigma=3e-4 * SIZE),
    rng=np.random.default_rng(0),
).points
TARGET = dqreg.prepare_target(PART)


def start(degrees: float, seed: int = 0) -> np.ndarray:
    """A start that far off; the scan is made in the part's frame, so the truth is the identity."""
    return disturbance(np.random.default_rng(seed), np.deg2rad(degrees), 0.05 * SIZE, PART.centre)


def error(result: dqreg.Registration) -> float:
    return worst_vertex_displacement(result.T_target_source, np.eye(4), PART.vertices) / SIZE


def test_a_start_beyond_the_loop_but_meant_comes_home() -> None:
    rough = [start(35.0, seed) for seed in range(4)]
    results = [TARGET.register(SCAN, T, effort="fast") for T in rough]
    # 20,000 points: to a tenth of the noise.
    assert max(error(r) for r in results) <= 5e-5
    assert {r.verdict.level for r in results} == {"accepted"}


@pytest.mark.parametrize("axis", range(3))
def test_a_pose_that_explains_the_scan_significantly_better_is_the_answer_wherever_it_is(axis: int) -> None:
    half_turn = np.diag(np.where(np.arange(3) == axis, 1.0, -1.0))
    turned = pose.about(pose.from_parts(half_turn, np.zeros(3)), PART.centre)
    result = TARGET.register(SCAN, turned, effort="fast")
    assert error(result) <= 5e-5
    assert result.verdict.codes == ("accepted", "contradicted_start")
    assert "the pose is 180 degrees and " in result.verdict.reasons[1]


@pytest.mark.parametrize("degrees", [0.0, 130.0])
def test_a_start_beside_the_part_is_searched_beside_and_told(degrees: float) -> None:
    # Nothing of the scan is near: it is of the part all the same.
    away = pose.from_parts(np.eye(3), [3.0 * SIZE, 0.0, 0.0]) @ start(degrees)
    result = TARGET.register(SCAN, away, effort="fast")
    assert error(result) <= 5e-5
    assert result.verdict.codes == ("accepted", "contradicted_start")
    assert TARGET.register(SCAN, away, effort="fast", search="never").verdict.codes == ("no_correspondences",)
    assert "contradicted_start" not in TARGET.register(SCAN, start(35.0), effort="fast").verdict.codes


def test_clouds_that_were_put_beside_each_other_have_nothing_in_common() -> None:
    away = pose.from_parts(np.eye(3), [3.0 * SIZE, 0.0, 0.0])
    half = SCAN[:, 0] < np.median(SCAN[:, 0])
    result = dqreg.register(SCAN[half], SCAN[~half], away, effort="fast")
    assert result.verdict.codes == ("no_correspondences",)


@pytest.mark.parametrize(("bumps", "strays", "doubtful"), [(0.0, 0.0, False), (0.06, 0.0, True), (0.0, 0.1, False)])
def test_few_points_on_one_strip_are_evidence_and_strays_are_not(bumps: float, strays: float, doubtful: bool) -> None:
    # The verdict allows for as many; a strip of points off the part is what a wall settled on its wrong side leaves.
    rng = np.random.default_rng(5)
    points = sample_mesh(PART, 8_000, rng).points
    strip = np.argsort(np.abs(points[:, 0] - PART.centre[0]))[: round(bumps * len(points))]
    points[strip] += 0.02 * SIZE
    away = PART.centre + rng.uniform(-0.5, 0.5, (round(strays * len(points)), 3)) * SIZE
    scan = np.concatenate([points, away])
    problem = problem_of(scan, PART, np.eye(4))
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(problem.reach(prepared), constraints)
    assert (
        is_doubtful(coarse_to_fine(problem, prepared, problem.to_centred(np.eye(4)), settings, constraints)) == doubtful
    )


def test_the_time_limit_returns_no_pose_worse_than_the_start() -> None:
    near, far = start(2.0), start(30.0, 3)
    problem = problem_of(SCAN, PART, near)
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(0.2 * SIZE, constraints)
    ended = coarse_to_fine(problem, prepared, problem.to_centred(far), settings, constraints)
    run = dataclasses.replace(
        ended.run, status="time limit", T_target_source=problem.to_centred(far), history=ended.run.history[:1]
    )
    kept = best_seen(dataclasses.replace(ended, run=run), problem.to_centred(near))
    np.testing.assert_array_equal(kept.T_target_source, problem.to_centred(near))
    # And the answer of a registration with no time at all is no worse either, though one step has been made.
    found = TARGET.register(SCAN, near, effort="fast", time_limit=1e-6)
    assert found.status == "time limit"
    assert error(found) <= error(dataclasses.replace(found, T_target_source=near)) + 0.005


def test_a_good_pose_is_not_searched_for_again() -> None:
    stages: list[object] = []
    result = TARGET.register(SCAN, start(5.0), effort="fast", observe_search=stages.append)
    assert result.verdict.level == "accepted"
    assert stages == []


def test_a_corner_of_a_box_fits_at_the_other_corners() -> None:
    # Eight corners, three ways each; three of the 23 others are symmetries of the box.
    part = dqreg.Mesh(*box((30.0, 40.0, 55.0)))
    points = sample_mesh(part, 8_000, np.random.default_rng(0)).points
    corner = points[np.linalg.norm(points - part.vertices.max(axis=0), axis=1) < 15.0]
    result = dqreg.register(corner + 0.02 * np.random.default_rng(1).normal(size=corner.shape), part, "identity")
    assert result.verdict.codes == ("alternative_poses",)
    assert sum(not other.symmetry for other in result.alternatives) >= 4
    assert sum(bool(other.symmetry) for other in result.alternatives) == 3


@pytest.mark.parametrize("options", [{"method": "dq"}, {"dof": "rz tx ty"}, {"search": "never"}])
def test_what_was_asked_for_in_so_many_words_is_done_alone(options: dict) -> None:
    stages: list[object] = []
    TARGET.register(SCAN[::8], start(120.0), effort="fast", observe_search=stages.append, **options)
    assert stages == []


def test_always_searches_beside_a_good_start_and_keeps_the_pose() -> None:
    stages: list[object] = []
    result = TARGET.register(SCAN, start(5.0), effort="fast", search="always", observe_search=stages.append)
    assert stages != []
    assert error(result) <= 5e-5
    assert result.verdict.level == "accepted"
    assert result.settings["search"] == "always"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"start": None, "search": "never"}, "there is none"),
        ({"start": None, "verdict": False}, "verdict=False leaves the pose to start="),
        ({"start": np.eye(4), "verdict": False, "search": "always"}, "leave it out, or verdict=False"),
        ({"start": np.eye(4), "verdict": False, "scale": "solve"}, "leave it out, or verdict=False"),
        ({"start": np.eye(4), "verdict": "no"}, "verdict must be True or False"),
        ({"start": np.eye(4), "search": "always", "dof": "rz"}, "know nothing of dof"),
        ({"start": np.eye(4), "search": "sometimes"}, "never, doubt, always"),
    ],
)
def test_a_search_that_cannot_be_is_refused(given: dict, words: str) -> None:
    with pytest.raises(dqreg.InputError, match=words):
        TARGET.register(SCAN, effort="fast", **given)


def test_history_counts_on() -> None:
    result = TARGET.register(SCAN, start(35.0, 1), effort="fast")
    assert [record.number for record in result.history] == list(range(1, len(result.history) + 1))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mirrored_scan_of_a_nearly_symmetric_part_is_told(mirrored: bool) -> None:
    # Truth: the pose drawn here; a mirrored scan has none. Dense enough to see on which side the bracket's hole is.
    T = random_pose(np.random.default_rng(0), SIZE, PART.centre)
    points = SCAN * [1.0, 1.0, -1.0] if mirrored else SCAN
    verdict = TARGET.register(pose.apply(T, points), effort="fast").verdict
    assert verdict.level == ("suspect" if mirrored else "accepted")
    assert mirrored == ("mirrored" in verdict.codes)


def test_a_sparse_scan_turned_inside_out_is_told_however_sure_its_first_pose_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Its 469 points read a noise of 3 % of the size: all residuals are small against that, and what spoke against its
    # first pose was the pose's own standard deviation. No pose is right; 30 % of the points are off the part at it.
    monkeypatch.setattr("dqreg.trust.limits.MAX_SIGMA_DIAGONALS", 1.0)
    monkeypatch.setattr("dqreg.trust.limits.MAX_SIGMA_RAD", 3.0)
    T = disturbance(np.random.default_rng(1), np.deg2rad(4.0), 0.02 * SIZE, np.zeros(3))
    verdict = dqreg.register(-bracket_points(25, seed=0), bracket_mesh(), T, effort="fast").verdict
    assert "mirrored" in verdict.codes


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_sparse_scan_of_the_mirror_image_is_told(mirrored: bool) -> None:
    # A block with a notch in one edge, nearer to one end: of 600 points no whole patch deviates.
    filled = np.ones((3, 2, 2), dtype=bool)
    filled[1, 1, 1] = False
    grid = [60.0 * np.array([0.0, 0.5, 0.8, 1.0]), np.array([0.0, 64.0, 80.0]), np.array([0.0, 40.0, 50.0])]
    part, rng = dqreg.Mesh(*weld(cells(grid, filled))), np.random.default_rng(0)
    points = sample_mesh(part, 600, rng).points
    points += 3e-4 * part.diagonal * rng.normal(size=points.shape)
    points = points * [-1.0, 1.0, 1.0] + [60.0, 0.0, 0.0] if mirrored else points
    codes = dqreg.register(points, part, "identity").verdict.codes
    assert codes == (("mirrored",) if mirrored else ("accepted",))


@pytest.mark.parametrize(("points", "height", "doubtful"), [(400, 0.22, False), (800, 0.22, True), (800, 0.8, False)])
def test_much_that_lies_off_a_target_of_the_size_of_its_scan_is_doubtful(
    points: int, height: float, doubtful: bool
) -> None:
    # A ring upside down fits; its hub, a quarter of the points, hangs in the air and looks like outliers. What makes a
    # scene of a scan is another object.
    part = dqreg.Mesh(*flange(hub_height=30.0, bolts=6))
    rng = np.random.default_rng(3)
    on = sample_mesh(part, 3_000, rng).points + 3e-4 * part.diagonal * rng.normal(size=(3_000, 3))
    off = part.centre + 6.0 * rng.normal(size=(points, 3)) + [0.0, 0.0, height * part.diagonal]
    problem = problem_of(np.concatenate([on, off]), part, np.eye(4))
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(problem.reach(prepared), constraints)
    fit = coarse_to_fine(problem, prepared, problem.to_centred(np.eye(4)), settings, constraints)
    assert is_doubtful(fit) == doubtful


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_a_part_is_found_among_objects_that_explain_more_of_the_scene(seed: int) -> None:
    # Truth: of the case. On the table a face of the part explains more points than there are on the part: 90 or 180
    # degrees off. Measured: 0.016 degrees.
    case = load_case(Path(dqreg.__file__).parents[1] / "datasets_synth" / "feeder_table")
    result = dqreg.register(case.scan, case.part, seed=seed)
    assert result.verdict.level == "accepted"
    assert pose.angle_between(result.T_target_source, case.T_target_source) < np.deg2rad(0.05)


def test_poses_that_an_unconstrained_motion_leads_to_are_one() -> None:
    # A plane on a plane: shifts in it and rotations about its normal are free, however far; its other side is not.
    rng = np.random.default_rng(0)
    vertices, faces = np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    scan = np.column_stack([rng.uniform(-1.0, 1.0, (500, 2)), 1e-3 * rng.normal(size=500)])
    problem = problem_of(scan, dqreg.Mesh(vertices, faces), np.eye(4))
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(problem.reach(prepared), constraints)
    fit = coarse_to_fine(problem, prepared, problem.to_centred(np.eye(4)), settings, constraints)
    free = [twist.exp([0, 0, 2.0, 0.5, -0.7, 0]), twist.exp([0, 0, -0.3, 0, 1.0, 0])]
    over, above = twist.exp([np.pi, 0, 0, 0, 0, 0]), twist.exp([0, 0, 0, 0, 0, 0.2])
    others = np.stack([free[0], over, free[1], free[0] @ over, above]) @ fit.T_target_source
    np.testing.assert_array_equal(but_slid(fit, others), others[[1, 4]])


@pytest.mark.parametrize(("degrees", "is_moved"), [(180.0, True), (0.0, False)])
def test_of_poses_that_a_near_symmetry_exchanges_the_one_by_the_start_is_kept(degrees: float, is_moved: bool) -> None:
    # Two clouds of all of a block, in its frame: the start is the truth, the fit half a turn away, or there.
    block, rng = dqreg.Mesh(*box((90.0, 60.0, 40.0))), np.random.default_rng(0)
    scan, stands = (sample_mesh(block, 4_000, rng).points for _ in range(2))
    half_turn = pose.about(pose.exp(np.array([0.0, 0.0, np.deg2rad(degrees), 0.0, 0.0, 0.0])), block.centre)
    problem = problem_of(scan, stands, np.eye(4))
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(problem.reach(prepared), constraints, even=prepared.even)
    start, width = problem.to_centred(np.eye(4)), 1e-3 * block.diagonal
    fit = coarse_to_fine(problem, prepared, problem.to_centred(half_turn), settings, constraints)
    found, others = meant_copy(fit, start, width)
    assert (found is not fit) is is_moved
    # Sampling leaves a hundredth of the way between neighbours.
    assert worst_vertex_displacement(problem.to_caller(found.T_target_source), np.eye(4), block.vertices) <= 0.2
    # The block looks the same from both.
    assert not len(others)


@pytest.mark.parametrize("seed", [13, 16])
def test_what_too_little_speaks_for_is_named_beside_a_pose_that_happens_to_pass(seed: int) -> None:
    # A scan within one face of a plate: turned by a quarter it reaches the rims, which then hold it.
    sides, rng = np.array([15.1, 22.0, 1.4]), np.random.default_rng(seed)
    plate = dqreg.Mesh(*box(tuple(sides)))
    points = np.column_stack([0.677 * sides[:2] * rng.uniform(-0.5, 0.5, (4_800, 2)), np.full(4_800, 0.5 * sides[2])])
    points += rng.normal(scale=5e-3 * plate.diagonal, size=points.shape)
    tilts, turn = 0.02 * rng.normal(size=2), rng.uniform(-0.15, 0.15)
    near = pose.exp([*tilts, turn, *rng.uniform(-1.0, 1.0, 2), 0.1 * rng.normal()])
    assert "alternative_poses" in dqreg.register(points, plate, near).verdict.codes
