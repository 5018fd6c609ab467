from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import Mesh, PointCloud
from dqreg.registration.assessment.assess import evidence_of, uncertainty_of
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.pipeline import registration_of
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from dqreg.trust import judge
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.registration.scenes import problem_of

OFFSET = np.array([5_000.0, -300.0, 80.0])


@pytest.fixture(scope="module")
def fit() -> Fit:
    part = Mesh(*bracket())
    points = bracket_points(60, seed=0) + bracket_mesh().centre + part.centre
    start = pose.from_parts(np.eye(3), 1.0 - OFFSET)
    problem = problem_of(PointCloud(points + OFFSET), part, start, effort="best")
    prepared, T = problem.prepare(), problem.to_centred(start)
    constraints = problem.constraints(T)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    return coarse_to_fine(problem, prepared, T, settings, constraints)


def test_a_detail_with_points_off_the_part_together_may_be_of_another_place(fit: Fit) -> None:
    part = fit.target.geometry
    points = bracket_points(60, seed=0) + bracket_mesh().centre + part.centre
    points = points[np.linalg.norm(points - points[np.argmax(points[:, 0])], axis=1) < 0.35 * part.diagonal]
    # A strip of the detail stands out by 1.5 % of the size, as where another place of the part has an edge.
    strip = points[:, 0] > np.quantile(points[:, 0], 0.95)
    points = points + np.where(strip, 0.015 * part.diagonal, 0.0)[:, None] * [1.0, 0.0, 0.0]
    problem = problem_of(PointCloud(points), part, np.eye(4), effort="fast")
    prepared, T = problem.prepare(), problem.to_centred(np.eye(4))
    constraints = problem.constraints(T)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    detail = coarse_to_fine(problem, prepared, T, settings, constraints)
    found, whole = (evidence_of(each, uncertainty_of(each)) for each in (detail, fit))
    assert found.is_detail
    assert "local_difference" in judge(found).codes
    assert not whole.is_detail
    assert whole.share_together == 0.0


def answer_of(fit: Fit) -> Registration:
    uncertainty = uncertainty_of(fit)
    return registration_of(fit, uncertainty, judge(evidence_of(fit, uncertainty)), ())


def test_the_answer_is_in_the_frames_of_the_caller(fit: Fit) -> None:
    answer = answer_of(fit)
    size = fit.target.surface.diagonal
    at = fit.problem.source.origin
    expected = pose.from_parts(np.eye(3), -OFFSET)
    # Noise 3e-4 of the size over 2,700 points: a bound for a wrong frame, not of accuracy.
    assert pose.offset_between(answer.T_target_source, expected, at=at) <= 1e-3 * size
    assert answer.verdict.level == "accepted"
    assert "read" in answer.timings
    assert answer.settings["effort"] == "best"
    np.testing.assert_array_equal(answer.settings["centre"], fit.target.origin)


def test_rms_and_inlier_fraction_are_those_of_the_last_pairs(fit: Fit) -> None:
    answer = answer_of(fit)
    w, d = fit.run.weights, fit.run.pairs.distances
    assert answer.rms == pytest.approx(np.sqrt(np.average(d**2, weights=w)), rel=1e-12)
    assert answer.inlier_fraction == pytest.approx(w.mean(), rel=1e-12)


def test_the_covariance_is_about_the_middle_of_the_target(fit: Fit) -> None:
    covariance = answer_of(fit).covariance
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12, atol=0.0)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    # Where the target stands has no say: nothing of the far frame leaks into the numbers.
    moved = dataclasses.replace(fit.target, origin=fit.target.origin + 1e6)
    far = dataclasses.replace(fit, target=moved, problem=dataclasses.replace(fit.problem, target=moved))
    np.testing.assert_array_equal(answer_of(far).covariance, covariance)


@pytest.mark.parametrize("status", ["no correspondences", "degenerate correspondences"])
def test_nothing_found_is_nan_and_failed(fit: Fit, status: str) -> None:
    nothing = dataclasses.replace(fit, run=dataclasses.replace(fit.run, status=status))
    answer = answer_of(nothing)
    assert np.isnan(answer.T_target_source).all()
    assert np.isnan(answer.covariance).all()
    assert np.isnan(answer.rms)
    assert answer.inlier_fraction == 0.0
    assert answer.observability == ()
    assert answer.verdict.level == "failed"


def test_a_run_without_a_record_found_nothing(fit: Fit) -> None:
    silent = dataclasses.replace(fit, run=dataclasses.replace(fit.run, history=()))
    assert answer_of(silent).verdict.level == "failed"
