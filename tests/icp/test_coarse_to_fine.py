from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Closest, CloudSurface, Mesh, MeshSurface, PointCloud, Scan, prepare_scan, sample_mesh
from dqreg.icp import (
    ESTIMATORS,
    IcpSettings,
    Run,
    Stopping,
    align_coarse_to_fine,
    coarse_to_fine,
    full_resolution,
    level,
    points_and_normals,
    points_to_planes,
    smallest_kernel_scale,
)
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.icp.history import Iteration
from dqreg.icp.noise_by_face import points_to_weighted_faces
from dqreg.rigid import pose
from dqreg.synth import disturbance, worst_vertex_displacement
from dqreg.synth.parts import cylinder
from tests.icp.scenes import bracket_mesh, bracket_points, bumpy_cloud

PART = bracket_mesh()
SIZE = PART.diagonal
PLAN = IcpSettings(points_and_normals, max_distance=0.2 * SIZE, fine=points_to_planes)
NOISE = 3e-4


@pytest.fixture(scope="module")
def surface() -> MeshSurface:
    return MeshSurface(PART)


@pytest.fixture(scope="module")
def small() -> Scan:
    return prepare_scan(PointCloud(bracket_points(100, seed=0)))


@pytest.fixture(scope="module")
def dense() -> Scan:
    return prepare_scan(PointCloud(bracket_points(300, seed=0)), fitted=2_000)


@pytest.fixture(scope="module")
def everything(surface: MeshSurface, dense: Scan) -> Run:
    """All points of the dense scan on the part."""
    return align_coarse_to_fine(dense, surface, start_of(0), PLAN)


def start_of(seed: int) -> FloatArray:
    return disturbance(np.random.default_rng(seed), np.deg2rad(12.0), 0.04 * SIZE, PART.centre)


def error(run: Run) -> float:
    # The scan is made in the part's frame: the truth is the identity, exactly.
    return worst_vertex_displacement(run.T_target_source, np.eye(4), PART.vertices) / SIZE


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (1, 2))])
def test_two_noisy_views_land_on_the_part_to_the_last_digit(surface: MeshSurface, seed: int) -> None:
    # A tenth of what point-to-point ICP reaches on 100,000 samples of a CAD part (2e-4 of its size).
    scan = prepare_scan(PointCloud(bracket_points(300, seed)))
    assert 60_000 < len(scan) < 80_000
    run = align_coarse_to_fine(scan, surface, start_of(seed), PLAN)
    mixture = run.mixture
    assert run.status == "converged"
    assert error(run) <= 2e-5
    # The width is the noise along the normal: less than along the ray, and no less than half of it.
    assert 0.5 * NOISE <= mixture.scale / SIZE <= NOISE
    assert mixture.inlier_fraction >= 0.99


@pytest.mark.parametrize("method", ESTIMATORS)
def test_each_estimator_gets_there(surface: MeshSurface, small: Scan, method: str) -> None:
    run = align_coarse_to_fine(small, surface, start_of(5), IcpSettings(ESTIMATORS[method], PLAN.max_distance))
    assert error(run) <= 1e-4


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_half_strays_and_a_table_do_not_move_the_part(surface: MeshSurface, seed: int) -> None:
    # Half of all points are strays in a box of three times the part's size; a table of up to as many points as the
    # part's own lies around its foot and out to twice its size, and none under it, where no scanner sees.
    rng = np.random.default_rng(seed)
    on_part = bracket_points(100, seed)
    low, high = PART.bounds
    sheet = rng.uniform(2 * low[:2], 2 * high[:2], (len(on_part), 2))
    sheet = sheet[((sheet < low[:2]) | (sheet > high[:2])).any(axis=1)]
    table = np.column_stack([sheet, rng.normal(low[2], NOISE * SIZE, len(sheet))])
    strays = rng.uniform(3 * low, 3 * high, (len(on_part) + len(table), 3))
    scan = prepare_scan(PointCloud(np.concatenate([on_part, table, strays])))
    run = align_coarse_to_fine(scan, surface, start_of(seed), PLAN)
    mixture = run.mixture
    assert run.status == "converged"
    assert error(run) <= 5e-5
    # Strays must not widen the kernel.
    assert mixture.scale <= NOISE * SIZE
    # Every point is known to be of the part or not, so the share of inliers among those looked at is known.
    known = {tuple(point) for point in on_part}
    is_part = np.array([tuple(point) in known for point in scan.points])
    assert mixture.inlier_fraction == pytest.approx(is_part[run.weights > 0.0].mean(), abs=0.03)
    assert run.weights[is_part].mean() >= 0.9
    assert run.weights[~is_part].mean() <= 0.02


def test_an_exact_scan_is_found_to_the_floor_of_the_width(surface: MeshSurface) -> None:
    scan = prepare_scan(PointCloud(bracket_points(150, seed=0, sigma=0.0)))
    run = align_coarse_to_fine(scan, surface, start_of(1), PLAN)
    mixture = run.mixture
    assert error(run) <= 1e-6
    assert mixture.scale >= smallest_kernel_scale(scan, surface)


def test_the_floor_follows_the_noise_or_the_spacing_or_the_size(surface: MeshSurface, small: Scan) -> None:
    for noise, spacing, expected in [(0.1, 1.0, 0.03), (2.0, 1.0, 0.3), (0.0, 1.0, 1e-7 * SIZE)]:
        # On a mesh the noise of the quieter faces decides, where it is known.
        for scan in (
            dataclasses.replace(small, noise=noise, quiet=None, spacing=spacing),
            dataclasses.replace(small, noise=3.0 * noise, quiet=noise, spacing=spacing),
        ):
            assert smallest_kernel_scale(scan, surface) == pytest.approx(expected, rel=1e-12)


def test_records_run_through_all_stages_in_order(surface: MeshSurface, small: Scan) -> None:
    seen: list[Iteration] = []
    plan = dataclasses.replace(PLAN, fine=None)
    run = align_coarse_to_fine(small, surface, start_of(0), plan, observe=seen.append)
    assert [record.number for record in seen] == list(range(1, len(seen) + 1))
    assert seen == list(run.history)
    stages = [record.stage for record in seen]
    assert list(dict.fromkeys(stages)) == ["coarse", "annealed", "fine"]
    assert stages == sorted(stages, key=["coarse", "annealed", "fine"].index)
    fine = [record for record in seen if record.stage == "fine"]
    assert fine[-1].points == len(small)
    # The quick schedule's width falls in every iteration, by half at most.
    widths = np.array([record.kernel_scale for record in seen if record.stage == "annealed"])
    assert (widths[1:] >= 0.5 * widths[:-1] - 1e-12).all()
    assert widths[-1] < 0.01 * widths[0]


def test_no_iteration_is_run_twice(surface: MeshSurface, small: Scan) -> None:
    # Strays leave much of the scan unexplained, so that both schedules run to their ends: what they found is known.
    rng = np.random.default_rng(3)
    strays = PART.centre + SIZE * rng.uniform(-0.6, 0.6, (len(small) // 2, 3))
    scan = prepare_scan(PointCloud(np.vstack([small.points, strays])))
    run = align_coarse_to_fine(scan, surface, start_of(0), PLAN)
    records = [(r.stage, r.points, r.kernel_scale, r.rms) for r in run.history if r.stage != "fine"]
    assert {stage for stage, *_ in records} == {"coarse", "annealed"}
    assert len(set(records)) == len(records)
    assert [record.number for record in run.history] == list(range(1, len(run.history) + 1))


def test_an_explained_scan_needs_no_second_schedule(surface: MeshSurface, small: Scan) -> None:
    run = align_coarse_to_fine(small, surface, start_of(0), PLAN)
    mixture = run.mixture
    levels = list(dict.fromkeys((record.stage, record.points) for record in run.history))
    # Few points find the basin and are gone over again with planes; the last level is the favoured share or all.
    assert levels == [("coarse", 2_000), ("fine", 2_000), ("fine", len(small))]
    assert mixture.inlier_fraction >= 0.99
    # At most one look at all points, and one to confirm it.
    assert sum(record.points == len(small) for record in run.history) <= 2


def test_the_last_level_takes_as_many_points_as_the_plan_says(dense: Scan) -> None:
    cloud = CloudSurface(sample_mesh(PART, 20_000, np.random.default_rng(0)))
    run = align_coarse_to_fine(dense, cloud, start_of(0), dataclasses.replace(PLAN, finest=25_000))
    assert run.history[-1].points == pytest.approx(25_000, rel=0.03)


def test_clouds_of_two_shapes_are_asked_for_no_more_points_than_their_distances_tell_apart() -> None:
    target = CloudSurface(PointCloud(bumpy_cloud(20_000)))
    points = bumpy_cloud(20_000, seed=1)
    same, other = (prepare_scan(PointCloud(points * [1.0, 1.0, height])) for height in (1.0, 3.0))
    plan = dataclasses.replace(PLAN, max_distance=1.0, first_kernel_scale=0.1)
    kept, thinned = (align_coarse_to_fine(scan, target, np.eye(4), plan) for scan in (same, other))
    assert len(kept.pairs.scan) == 20_000
    assert len(thinned.pairs.scan) == pytest.approx(2_000, rel=0.5)


@pytest.mark.parametrize("finest", [15_000, 25_000, 60_000])
def test_on_a_mesh_all_points_have_their_say_for_few_questions(
    surface: MeshSurface, dense: Scan, everything: Run, finest: int
) -> None:
    assert 60_000 < len(dense) < 80_000
    run = align_coarse_to_fine(dense, surface, start_of(0), dataclasses.replace(PLAN, finest=finest))
    assert run.history[-1].points == len(run.pairs.scan) <= 0.45 * finest
    assert run.pairs.scan.represented >= 0.6 * len(dense)
    assert run.weights.sum() == pytest.approx(run.history[-1].inlier_fraction * run.pairs.scan.represented, rel=1e-12)
    # As many points as there are questions would lose a factor of two to four.
    assert error(run) <= 2.0 * error(everything)
    assert run.history[-1].rms == pytest.approx(everything.history[-1].rms, rel=0.05)


@pytest.mark.parametrize("last", ["coarse", "annealed", "fine"])
def test_the_observer_ends_all_stages_at_once(surface: MeshSurface, small: Scan, last: str) -> None:
    plan = dataclasses.replace(PLAN, fine=None)
    full = align_coarse_to_fine(small, surface, start_of(0), plan)
    number = next(record.number for record in full.history if record.stage == last) + 1
    run = align_coarse_to_fine(small, surface, start_of(0), plan, observe=lambda record: record.number < number)
    assert run.status == "stopped by observer"
    assert len(run.history) == number
    assert np.isfinite(run.T_target_source).all()


def test_out_of_reach_is_no_correspondences(surface: MeshSurface, small: Scan) -> None:
    run = align_coarse_to_fine(small, surface, pose.from_parts(np.eye(3), [5 * SIZE, 0.0, 0.0]), PLAN)
    assert run.status == "no correspondences"
    assert run.history == ()


def test_one_iteration_at_each_width_is_respected(surface: MeshSurface, small: Scan) -> None:
    plan = dataclasses.replace(PLAN, fine=None, stopping=Stopping(iterations=1))
    run = align_coarse_to_fine(small, surface, start_of(0), plan)
    widths = [record.kernel_scale for record in run.history if record.stage == "coarse"]
    assert len(set(widths)) == len(widths)


def test_a_scan_too_small_to_be_thinned_has_one_level(surface: MeshSurface) -> None:
    scan = prepare_scan(PointCloud(bracket_points(100, seed=0))).thinned(3_000)
    run = align_coarse_to_fine(scan, surface, start_of(0), PLAN)
    assert {record.points for record in run.history} == {3_000}
    assert error(run) <= 2e-4


@pytest.mark.parametrize("points", [60, 150])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_tracking_takes_few_steps_and_ends_where_patience_does(surface: MeshSurface, points: int, seed: int) -> None:
    # Scans in the part's frame; the few points are those of one level, so that the first look's level is the last.
    scan = prepare_scan(PointCloud(bracket_points(points, seed)))
    near = disturbance(np.random.default_rng(seed), np.deg2rad(0.5), 2e-3 * SIZE, PART.centre)
    run = align_coarse_to_fine(scan, surface, near, PLAN)
    mixture = run.mixture
    assert run.status == "converged"
    assert len(run.history) <= 3
    again = align_coarse_to_fine(scan, surface, run.T_target_source, PLAN)
    settled = again.mixture
    # Another run from the answer finds nothing to mend beyond a part of what so many points leave open.
    left = worst_vertex_displacement(again.T_target_source, run.T_target_source, PART.vertices)
    assert left <= 2.0 * mixture.scale / np.sqrt(len(scan))
    assert settled.scale == pytest.approx(mixture.scale, rel=0.1)


@pytest.mark.parametrize("finest", [None, 15_000])
def test_a_deadline_within_a_finer_level_is_told_as_what_it_is(
    surface: MeshSurface, dense: Scan, finest: int | None
) -> None:
    # The clock is asked between blocks of many rows, of which the levels after the coarse one have some.
    run = align_coarse_to_fine(dense, surface, start_of(0), dataclasses.replace(PLAN, finest=finest, deadline=0.0))
    assert run.status == "time limit"
    assert np.isfinite(run.T_target_source).all()


@pytest.mark.parametrize("finest", [None, 15_000])
def test_no_step_hangs_on_the_word_that_a_schedule_is_shown_by(
    surface: MeshSurface, dense: Scan, finest: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = dataclasses.replace(PLAN, finest=finest, last=points_to_weighted_faces)
    near = disturbance(np.random.default_rng(0), np.deg2rad(0.5), 2e-3 * SIZE, PART.centre)
    named = align_coarse_to_fine(dense, surface, near, plan)
    for room, name in ((coarse_to_fine, "TRACKING_SCHEDULE"), (full_resolution, "FINE_SCHEDULE")):
        other = dataclasses.replace(getattr(room, name), name=name)
        monkeypatch.setattr(room, name, other)
    run = align_coarse_to_fine(dense, surface, near, plan)
    assert [run.history[0].stage, run.history[-1].stage] == ["TRACKING_SCHEDULE", "FINE_SCHEDULE"]
    np.testing.assert_array_equal(run.T_target_source, named.T_target_source)
    assert [record.points for record in run.history] == [record.points for record in named.history]


def test_between_clouds_the_noise_of_most_faces_decides() -> None:
    part, rng = Mesh(*cylinder(segments=200)), np.random.default_rng(0)
    one, other = (sample_mesh(part, 1_000, rng).points for _ in range(2))
    scan = prepare_scan(PointCloud(one))
    assert scan.quiet is not None
    assert scan.quiet < scan.noise
    assert noise_on(scan, CloudSurface(PointCloud(other))) == scan.noise
    assert noise_on(scan, MeshSurface(part)) == scan.quiet


def test_a_last_step_within_the_noise_searches_no_face_anew_and_moves_the_pose_by_less_than_a_tenth_of_it(
    surface: MeshSurface, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan = prepare_scan(PointCloud(bracket_points(130, seed=0)))
    start = disturbance(np.random.default_rng(0), np.deg2rad(1.0), 0.005 * SIZE, PART.centre)
    asked: list[int] = []

    def closest(self: MeshSurface, points: FloatArray, *hint: Any) -> Closest:
        asked.append(len(points))
        return searched(self, points, *hint)

    searched = MeshSurface.closest
    monkeypatch.setattr(MeshSurface, "closest", closest)
    # One step may be enough as it is.
    monkeypatch.setattr(level, "SAMPLING_ERROR_SHARE", 0.1 * level.SAMPLING_ERROR_SHARE)
    run = align_coarse_to_fine(scan, surface, start, PLAN)
    steps = [record.points for record in run.history].count(len(scan))
    assert steps > 1
    assert asked.count(len(scan)) == 1
    monkeypatch.setattr(level, "MAX_SLIDE_SCALES", 0.0)
    other = align_coarse_to_fine(scan, surface, start, PLAN)
    assert asked.count(len(scan)) == 1 + steps
    apart = worst_vertex_displacement(run.T_target_source, other.T_target_source, PART.vertices)
    # What the noise leaves open: three numbers of the pose move a vertex.
    assert apart <= 0.1 * np.sqrt(3.0 / len(scan)) * NOISE * SIZE


def plate(rng: np.random.Generator, *, both_sides: bool) -> FloatArray:
    """Points, (n, 3), on a plate of 200 x 300 x 12, noise 0.1; all of it, or its lower half alone."""
    size = np.array([200.0, 300.0, 12.0])
    areas = np.prod(size) / np.repeat(size, 2)
    face = rng.choice(6, size=12_000, p=areas / areas.sum())
    points = rng.uniform(size=(len(face), 3)) * size
    for k in range(6):
        points[face == k, k // 2] = k % 2 * size[k // 2]
    kept = points if both_sides else points[points[:, 2] < 0.5 * size[2]]
    return kept + 0.1 * rng.normal(size=kept.shape)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (2, 3))])
def test_a_side_that_the_target_lacks_is_not_averaged_with_the_other(seed: int) -> None:
    # Both clouds are made in one frame: the truth is the identity. A wide kernel ends at half the thickness, 6; across
    # the plate thousands of points leave 0.003, and 0.1 is the noise of one.
    rng = np.random.default_rng(seed)
    scan, target = (PointCloud(plate(rng, both_sides=both)) for both in (True, False))
    start = disturbance(rng, np.deg2rad(0.5), 2.0, np.array([100.0, 150.0, 6.0]))
    plan = dataclasses.replace(PLAN, max_distance=72.0, fine=ESTIMATORS["generalised"])
    surface = CloudSurface(target)
    run = align_coarse_to_fine(prepare_scan(scan), surface, start, plan)
    numbers = [record.number for record in run.history]
    assert numbers == list(range(1, len(numbers) + 1))
    corners = np.array([[x, y, 0.0, 1.0] for x in (0.0, 200.0) for y in (0.0, 300.0)])
    assert np.abs((corners @ run.T_target_source.T)[:, 2]).max() < 0.1


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (2, 3))])
def test_between_clouds_extrapolated_steps_of_planes_end_where_plain_ones_do_and_sooner(seed: int) -> None:
    # Two noisy samples of one sheet: the truth is the identity. Each plain step is about half of the one before.
    rng, noise = np.random.default_rng(seed), 0.005
    one, other = (bumpy_cloud(12_000, 2 * seed + k) + noise * rng.standard_normal((12_000, 3)) for k in (0, 1))
    scan, target = prepare_scan(PointCloud(one)), CloudSurface(PointCloud(other))
    start = disturbance(rng, 0.03, 0.02, np.zeros(3))
    plan = IcpSettings(points_and_normals, 0.2, fine=ESTIMATORS["generalised"], first_kernel_scale=2.0 * noise)
    runs = [
        align_coarse_to_fine(scan, target, start, dataclasses.replace(plan, accelerate=extrapolated))
        for extrapolated in (True, False)
    ]
    few, many = (sum(record.points == len(scan) for record in run.history) for run in runs)
    assert few <= 0.75 * many
    # A quarter of the noise of one point is about what two samples leave open of their pose.
    assert max(scan._spread.motion(run.T_target_source, np.eye(4)) for run in runs) < 0.5 * noise
    assert scan._spread.motion(*(run.T_target_source for run in runs)) < 0.2 * noise


def test_between_clouds_an_observer_ends_the_run_wherever_it_stands() -> None:
    rng = np.random.default_rng(0)
    scan, target = (PointCloud(plate(rng, both_sides=both)) for both in (True, False))
    start = disturbance(rng, np.deg2rad(0.5), 2.0, np.array([100.0, 150.0, 6.0]))
    plan = dataclasses.replace(PLAN, max_distance=72.0, fine=ESTIMATORS["generalised"])
    prepared, surface = prepare_scan(scan), CloudSurface(target)
    whole = align_coarse_to_fine(prepared, surface, start, plan)
    # It begins by planes twice, beside the wide kernel: each of these ways is several iterations long.
    for last in range(1, len(whole.history) + 1, 3):
        seen: list[Iteration] = []

        def watch(record: Iteration, seen: list[Iteration] = seen, last: int = last) -> bool:
            seen.append(record)
            return len(seen) < last

        run = align_coarse_to_fine(prepared, surface, start, plan, watch)
        assert (run.status, len(seen), len(run.history)) == ("stopped by observer", last, last)
