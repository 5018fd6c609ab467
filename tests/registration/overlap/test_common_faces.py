"""The last step to a pose between two clouds: on the faces that both show."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg._records import replaced
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.task import TrustTask
from dqreg.compare.trust.trial import is_right
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.overlap.common_faces import _spread, on_common_faces, overlap_of, spread_on_common_faces
from dqreg.rigid import pose, twist
from dqreg.synth.many_views import street_drive
from dqreg.synth.parts import box as solid
from dqreg.trust.overlap import IndexedPoints, Overlap
from tests.registration.scenes import problem_of
from tests.strategies import FloatArray
from tests.trust.shapes import box

NOISE = 0.001
# Exact: both clouds are drawn from one box. A third of 2,000 places with the noise of both constrains each rotation
# with a lever of about a half: four standard deviations of 1.4 / (0.5 sqrt(700)) noises each.
T_TRUE, KNOWN = twist.exp(np.array([0.02, -0.03, 0.01, 0.03, 0.02, -0.04])), 0.4 * NOISE


def clouds(count: int = 3_000) -> tuple[FloatArray, FloatArray]:
    one, other = (
        box(rng := np.random.default_rng(seed), count)[0] + NOISE * rng.normal(size=(count, 3)) for seed in (1, 2)
    )
    return pose.apply(pose.inverse(T_TRUE), one), other


def fit_at(T: FloatArray, **options: object) -> Fit:
    source, target = clouds()
    problem = problem_of(PointCloud(source), PointCloud(target), np.eye(4), **options)
    prepared, start = problem.prepare(), problem.to_centred(np.eye(4))
    constraints = problem.constraints(start)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    return coarse_to_fine(problem, prepared, start, settings, constraints).at(problem.to_centred(T))


def test_a_pose_that_stopped_beside_the_truth_is_led_to_it() -> None:
    aside = twist.exp(np.array([0.004, -0.003, 0.005, 0.004, 0.006, -0.005])) @ T_TRUE
    fit = fit_at(aside)
    stepped = on_common_faces(fit)
    np.testing.assert_allclose(fit.problem.to_caller(stepped.T_target_source), T_TRUE, atol=KNOWN)
    last = stepped.run.history[-1]
    assert last.stage == "common faces"
    np.testing.assert_array_equal(last.T_target_source, stepped.T_target_source)
    # The correspondences are those of the new pose, and nothing is left to gain.
    np.testing.assert_array_equal(on_common_faces(stepped).T_target_source, stepped.T_target_source)
    assert np.median(stepped.run.pairs.distances) < np.median(fit.run.pairs.distances)


def test_a_loop_by_another_method_stays_where_it_ended() -> None:
    aside = twist.exp(np.array([0.004, -0.003, 0.005, 0.004, 0.006, -0.005])) @ T_TRUE
    fit = fit_at(aside, method="plane")
    assert on_common_faces(fit) is fit


@pytest.mark.parametrize("count", [3_000, 12_000])
def test_registration_ends_where_the_common_faces_fit_best(count: int) -> None:
    source, target = clouds(count)
    result = dqreg.register(source, target, "identity")
    np.testing.assert_allclose(result.T_target_source, T_TRUE, atol=KNOWN)
    assert result.verdict.level == "accepted"


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (2, 15))])
def test_two_sweeps_of_a_street_end_where_the_loop_over_their_cells_does(seed: int) -> None:
    # Exact: the street and the poses are made. So many returns of 20 mm a frame place it to a millimetre or two at
    # 10 m; a step on the few faces near the car would move it by 3 to 5, as it did for these.
    made = street_drive(2, rng=np.random.default_rng(seed))
    before, after = made.scans
    T_true = pose.inverse(made.T_world_scan[0]) @ made.T_world_scan[1]
    judged, alone = (dqreg.register(after, before, "identity", effort="fast", verdict=v) for v in (True, False))
    np.testing.assert_array_equal(judged.T_target_source, alone.T_target_source)
    off = pose.log(judged.T_target_source @ pose.inverse(T_true))
    assert 10.0 * np.linalg.norm(off[:3]) + np.linalg.norm(off[3:]) < 0.006
    assert judged.verdict.level == "accepted"


def test_clouds_without_common_faces_keep_their_pose() -> None:
    rng = np.random.default_rng(0)
    blob, other = rng.normal(size=(300, 3)), rng.normal(size=(300, 3))
    problem = problem_of(PointCloud(blob), PointCloud(other), np.eye(4))
    prepared, start = problem.prepare(), problem.to_centred(np.eye(4))
    constraints = problem.constraints(start)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    fit = coarse_to_fine(problem, prepared, start, settings, constraints)
    assert overlap_of(fit)[2] is None
    assert on_common_faces(fit) is fit


@pytest.mark.parametrize("share", [0.6, 1.0])
def test_a_plate_seen_from_both_sides_is_not_stepped_through(share: float) -> None:
    # Both show two of its sides, which hold the pose, and most of the rest of each lies opposite the other's: one
    # thickness of 10 off, to which a step led.
    plate = Mesh(*solid((80.0, 80.0, 10.0)))

    def seen(seed: int, height: float) -> PointCloud:
        rng = np.random.default_rng(seed)
        points = sample_mesh(plate, 8_000, rng).points
        away = np.abs(points - plate.bounds[0])
        sides = (away[:, :2].min(axis=1) < 1e-9) & (rng.random(len(points)) < share)
        points = points[(np.abs(points[:, 2] - height) < 1e-9) | sides]
        return PointCloud(points + 0.01 * rng.normal(size=points.shape))

    problem = problem_of(seen(1, plate.bounds[1, 2]), seen(2, plate.bounds[0, 2]), np.eye(4))
    prepared, start = problem.prepare(), problem.to_centred(np.eye(4))
    constraints = problem.constraints(start)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    fit = coarse_to_fine(problem, prepared, start, replaced(settings, first_kernel_scale=0.1), constraints)
    moved = pose.apply(on_common_faces(fit).T_target_source, plate.vertices)
    assert np.abs(moved - pose.apply(fit.T_target_source, plate.vertices)).max() < 1.0


def test_the_places_on_common_faces_know_how_far_a_step_to_them_errs() -> None:
    """Of 30 pairs of clouds with six numbers each the mean square of the error over its variance errs by 0.1."""
    lever, ratios = 1.5, []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        sides = [IndexedPoints.of(box(rng, 3_000)[0] + NOISE * rng.normal(size=(3_000, 3))) for _ in range(2)]
        overlap = Overlap.of(*sides, np.eye(4))
        assert overlap is not None
        covariance = _spread(overlap, lever)
        assert covariance is not None
        error = twist.log(overlap.best_step()[0]) * twist.scaling_by(lever)
        ratios.append(error @ np.linalg.solve(covariance, error) / 6.0)
    assert 0.6 < np.mean(ratios) < 1.4


@pytest.mark.parametrize("seed", [8601, 8604])
def test_a_kernel_that_stays_wide_leaves_no_uncertainty_that_the_common_faces_do_not(seed: int) -> None:
    task = KINDS["clouds-30-50"].task(seed)
    assert isinstance(task, TrustTask)
    found = dqreg.register(task.source, task.target, task.start)
    assert is_right(found.T_target_source, task)[0]
    assert found.verdict.level == "accepted"
    # About the middle of the target, where the covariance is.
    middle = pose.from_parts(np.eye(3), -np.array(found.settings["centre"]))
    error = twist.log(middle @ found.T_target_source @ pose.inverse(task.truths[0]) @ pose.inverse(middle))
    # Of six numbers that are so uncertain, the sum of squares is beyond this once in 10,000.
    assert error @ np.linalg.solve(found.covariance, error) < 27.9


@pytest.mark.parametrize(("ratio", "aside", "is_taken"), [(30.0, 0.0, True), (3.0, 0.0, False), (30.0, 0.01, False)])
def test_the_common_faces_are_asked_where_the_loop_is_wide_and_no_step_is_left(
    ratio: float, aside: float, is_taken: bool
) -> None:
    fit = on_common_faces(fit_at(T_TRUE))
    fit = fit.beside(pose.from_parts(np.eye(3), [aside, 0.0, 0.0]) @ fit.T_target_source)
    found = spread_on_common_faces(fit, replaced(fit.information, sigma=ratio * NOISE))
    assert (found is not None) == is_taken


def test_sides_of_walls_that_were_laid_on_each_other_are_left_for_the_place_that_their_rims_name() -> None:
    """Truth: of the views' generator. The pose had been wrong by the width of a wall, and the right one doubted."""
    task = KINDS["clouds-30-50"].task(8602)
    assert isinstance(task, TrustTask)
    for start in (task.start, task.truths[0]):
        found = dqreg.register(task.source, task.target, start)
        assert is_right(found.T_target_source, task)[0]
        assert found.verdict.level == "accepted"
