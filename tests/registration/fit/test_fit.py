from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import sample_mesh
from dqreg.icp.history import Iteration
from dqreg.registration.assessment.assess import uncertainty_of
from dqreg.registration.fit.fit import coarse_to_fine
from dqreg.rigid import pose
from dqreg.synth import disturbance
from dqreg.trust.covariance import covariance_of
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.registration.scenes import fit_of, problem_of

PART = bracket_mesh()
POINTS = bracket_points(60, seed=0)
START = disturbance(np.random.default_rng(0), np.deg2rad(8.0), 0.03 * PART.diagonal, PART.centre)


def test_the_more_noise_hides_the_spacing_the_less_residuals_follow_a_displacement() -> None:
    # Truth: both clouds are drawn in one frame, and neighbours of 6,000 points stand about as far apart as `apart`.
    rng, count = np.random.default_rng(1), 6_000
    apart = float(np.sqrt(PART.face_areas.sum() / count))
    fits = []
    for noise in (0.02, 0.5, 2.0):
        clouds = (sample_mesh(PART, count, rng).points + rng.normal(scale=noise * apart, size=(count, 3)) for _ in "ab")
        fits.append(fit_of(problem_of(*clouds, np.eye(4), effort="fast")))
    shares = [fit.followed for fit in fits]
    assert 1.0 >= shares[0] > 0.9
    assert shares[0] > shares[1] > shares[2]
    assert shares[2] < 0.5
    # The pose errs by so much more than the Gauss-Newton Hessian says.
    expected = covariance_of(fits[2].information) / shares[2] ** 2
    np.testing.assert_allclose(uncertainty_of(fits[2]).covariance, expected, rtol=1e-12)
    # Of a mesh the nearest point moves along.
    assert fit_of(problem_of(POINTS, PART, START, effort="fast")).followed == 1.0


def test_a_resumed_fit_goes_on_with_the_history_and_the_observer_sees_the_same_records() -> None:
    seen: list[Iteration] = []
    problem = problem_of(POINTS, PART, START, effort="fast", observe=seen.append)
    first = fit_of(problem)
    again = first.resumed(first.T_target_source, None)
    assert again.run.history[: len(first.run.history)] == first.run.history
    assert len(again.run.history) > len(first.run.history)
    assert [record.number for record in again.run.history] == list(range(1, len(again.run.history) + 1))
    assert [record.number for record in seen] == [record.number for record in again.run.history]
    # In the caller's frames.
    last = problem.to_caller(again.run.history[-1].T_target_source)
    np.testing.assert_array_equal(seen[-1].T_target_source, last)


def test_a_resumed_fit_is_the_run_itself_from_that_pose() -> None:
    problem = problem_of(POINTS, PART, START, effort="fast")
    first = fit_of(problem)
    alone = coarse_to_fine(problem, first.prepared, first.T_target_source, first.settings, first.constraints)
    again = first.resumed(first.T_target_source, None)
    np.testing.assert_array_equal(again.T_target_source, alone.T_target_source)
    assert again.run.status == alone.run.status
    assert again.run.mixture == alone.run.mixture


def test_locked_motions_hold_after_every_run_though_the_observer_cuts_it_short() -> None:
    problem = problem_of(POINTS, PART, START, dof="rz tx ty", observe=lambda record: record.number % 3 != 0)
    first = fit_of(problem)
    assert first.run.status == "stopped by observer"
    for fit in (first, first.resumed(first.T_target_source, None)):
        change = problem.to_caller(fit.T_target_source) @ pose.inverse(START)
        np.testing.assert_allclose(change[2], [0.0, 0.0, 1.0, 0.0], atol=1e-12 * PART.diagonal)


def test_the_time_limit_is_the_status_of_whatever_it_ends() -> None:
    fit = fit_of(problem_of(POINTS, PART, START, time_limit=1e-9))
    assert fit.run.status == "time limit"
    assert fit.run.ended_early
    assert fit.resumed(fit.T_target_source, None).run.status == "time limit"


@pytest.mark.parametrize("status", ["no correspondences", "degenerate correspondences"])
def test_nothing_found_has_no_figures(status: str) -> None:
    fit = fit_of(problem_of(POINTS, PART, START, effort="fast"))
    nothing = dataclasses.replace(fit, run=dataclasses.replace(fit.run, status=status))
    assert fit.found
    assert not nothing.found
    assert np.isnan(nothing.run.rms)
    assert nothing.run.inlier_fraction == 0.0


@pytest.mark.parametrize("share", [0.01, 0.5])
def test_a_largest_distance_that_was_given_hides_no_point_from_the_verdict(share: float) -> None:
    plain = fit_of(problem_of(POINTS, PART, START, effort="fast")).agreement
    given = fit_of(problem_of(POINTS, PART, START, effort="fast", max_distance=share * PART.diagonal)).agreement
    assert given.near == pytest.approx(plain.near, rel=1e-12)
