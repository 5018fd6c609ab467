"""One level of points: how its kernel narrows, what it explains, and what ends it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan
from dqreg.icp import IcpSettings, find_correspondences, points_to_planes
from dqreg.icp.coarse_to_fine import PATIENT_SCHEDULE, QUICK_SCHEDULE
from dqreg.icp.history import Iteration
from dqreg.icp.level import EXPLAINED_FRACTION, MIN_SCALE_RATIO, Level
from dqreg.icp.loop import Alignment, Run
from dqreg.rigid import pose
from dqreg.solvers.robust import InlierMixture
from tests.icp.scenes import bracket_mesh, bracket_points, motion

PART, POINTS = bracket_mesh(), bracket_points(40, seed=0)
SIZE = PART.diagonal
TRUE = motion(np.deg2rad(4.0), 0.02 * SIZE, 1)


def level_of(unit: float = 1.0, *, near: bool = False, strays: int = 0) -> Level:
    """A part, and its scan out of place by `TRUE`; strays lie ten sizes off."""
    points = POINTS
    if strays:
        points = np.concatenate([points, points[:strays] + 10.0 * SIZE])
    points = pose.apply(pose.inverse(TRUE), points)
    scan = prepare_scan(PointCloud(unit * points)).thinned(600)
    surface = MeshSurface(Mesh(unit * PART.vertices, PART.faces))
    settings = IcpSettings(estimator=points_to_planes, max_distance=unit * 0.2 * SIZE)
    return Level(scan, surface, settings, floor=unit * 1e-4 * SIZE, last=True, near=near)


def start_of(level: Level) -> InlierMixture:
    return InlierMixture.widest(level.plan.max_distance, level.floor)


def ended(level: Level, start: FloatArray | None = None, **given: object) -> Alignment:
    T = np.eye(4) if start is None else start
    return level.descend(start_of(level), T, PATIENT_SCHEDULE, None, 1, **given)  # type: ignore[arg-type]


def test_it_ends_at_the_truth_and_its_kernel_never_falls_too_fast_nor_too_low() -> None:
    level = level_of()
    run = ended(level)
    assert run.status == "converged"
    off = pose.apply(run.T_target_source @ pose.inverse(TRUE), PART.vertices) - PART.vertices
    assert np.linalg.norm(off, axis=1).max() < 1e-3 * SIZE
    widths = np.array([record.kernel_scale for record in run.history])
    assert widths[0] == start_of(level).scale
    assert (widths >= level.floor).all()
    assert (widths[1:] >= MIN_SCALE_RATIO * widths[:-1] * (1.0 - 1e-12)).all()
    assert widths[-1] < 0.1 * widths[0]


def test_near_the_answer_it_may_fall_at_once() -> None:
    run = ended(level_of(near=True), TRUE)
    widths = np.array([record.kernel_scale for record in run.history])
    assert (widths[1:] / widths[:-1]).min() < MIN_SCALE_RATIO


def test_iterations_are_numbered_on_and_seen_once() -> None:
    level, seen = level_of(), list[Iteration]()
    run = level.descend(start_of(level), np.eye(4), PATIENT_SCHEDULE, seen.append, 7)
    assert [record.number for record in run.history] == list(range(7, 7 + len(run.history)))
    assert [record.number for record in seen] == [record.number for record in run.history]
    assert {record.stage for record in run.history} == {PATIENT_SCHEDULE.name}


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_unit_changes_nothing(unit: float) -> None:
    expected, run = ended(level_of()), ended(level_of(unit))
    T = run.T_target_source.copy()
    T[:3, 3] /= unit
    np.testing.assert_allclose(T, expected.T_target_source, rtol=0, atol=1e-6 * SIZE)
    assert run.mixture.scale / unit == pytest.approx(expected.mixture.scale, rel=1e-3)
    assert run.status == expected.status


def test_it_ends_where_it_is_enough_and_where_the_caller_says_so() -> None:
    level = level_of()
    run = ended(level, enough=lambda run, mixture: len(run.history) >= 2)
    assert len(run.history) < len(ended(level).history)
    # What was learned last comes with it.
    assert run.mixture != start_of(level)
    stopped = level.descend(start_of(level), np.eye(4), PATIENT_SCHEDULE, lambda record: record.number < 3, 1)
    assert stopped.status == "stopped by observer"
    assert len(stopped.history) == 3


def test_one_step_a_width_that_does_not_settle_is_stalled_and_no_limit_of_the_caller() -> None:
    level = level_of()
    few = dataclasses.replace(QUICK_SCHEDULE, stages=2)
    run = level.descend(start_of(level), np.eye(4), few, None, 1)
    assert (run.status, len(run.history)) == ("stalled", 2)


def test_once_keeps_its_width() -> None:
    level, mixture = level_of(), InlierMixture.starting(0.01 * SIZE, 0.2 * SIZE)
    run = level.once(mixture, PATIENT_SCHEDULE, None, 5, find_correspondences(level.scan, level.surface, TRUE))
    assert run.mixture == mixture
    assert {record.kernel_scale for record in run.history} == {mixture.scale}
    assert run.history[0].number == 5


@pytest.mark.parametrize(("kept", "fraction"), [(1.0, 0.95), (0.5, 1.0), (1.0, 0.5)])
def test_a_scan_is_explained_where_most_of_all_its_points_are_inliers(kept: float, fraction: float) -> None:
    level, mixture = level_of(), InlierMixture(0.01 * SIZE, fraction, 0.2 * SIZE)
    pairs = find_correspondences(level.scan, level.surface, TRUE)
    weights = np.where(np.arange(len(pairs.scan)) < kept * len(pairs.scan), 1.0, 0.0)
    run = Run(TRUE, "converged", (), pairs, weights)
    assert level.explains(run, mixture) == (kept * fraction >= EXPLAINED_FRACTION)


def test_the_nearer_of_two_ends_explains_the_distances_better() -> None:
    level = level_of(strays=30)
    right = ended(level)
    width, aside = right.mixture, motion(0.05, 0.05 * SIZE, 4) @ TRUE
    wrong = level.once(
        width, PATIENT_SCHEDULE, lambda record: False, 1, find_correspondences(level.scan, level.surface, aside)
    )
    assert level.mean_nll(right) < level.mean_nll(wrong)
    # Beyond a limit all are outliers alike, however far.
    assert level.mean_nll(right, 3.0 * width.scale) < level.mean_nll(wrong, 3.0 * width.scale)
    limit = 3.0 * width.scale
    far = np.where(wrong.pairs.distances > limit, 2.0 * wrong.pairs.distances, wrong.pairs.distances)
    farther = dataclasses.replace(wrong.pairs, closest=dataclasses.replace(wrong.pairs.closest, distances=far))
    assert level.mean_nll(dataclasses.replace(wrong, pairs=farther), limit) == level.mean_nll(wrong, limit)
    assert level.mean_nll(right, 10.0 * level.plan.max_distance) == level.mean_nll(right)
