from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, prepare_scan
from dqreg.icp import Plan, points_and_normals, points_to_planes, run_graduated
from dqreg.registration.assess import Outcome, from_work, to_work
from dqreg.registration.source import centre_source
from dqreg.registration.target_index import index_target
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.strategies import poses, translations

OFFSET = np.array([5_000.0, -300.0, 80.0])


@settings(deadline=None, max_examples=100)
@given(poses(), translations(), translations())
def test_the_two_frames_carry_the_same_motion(T: FloatArray, target: FloatArray, source: FloatArray) -> None:
    work = to_work(T, target, source)
    size = 1.0 + np.abs(T[:3, 3]).max() + np.abs(target).max() + np.abs(source).max()
    point = np.array([1.0, -2.0, 3.0])
    # A source point, by the caller's frames and by the centred ones.
    np.testing.assert_allclose(
        pose.apply(work, point - source) + target, pose.apply(T, point), atol=1e-14 * size, rtol=0.0
    )
    np.testing.assert_allclose(from_work(work, target, source), T, atol=1e-14 * size, rtol=0.0)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    vertices, faces = bracket()
    target = index_target(Mesh(vertices, faces))
    points = bracket_points(60, seed=0) + bracket_mesh().centre + target.origin
    source = centre_source(PointCloud(points + OFFSET), None, None, np.random.default_rng(0))
    scan = prepare_scan(source.cloud)
    plan = Plan(points_and_normals, 0.2 * target.surface.diagonal, fine=points_to_planes)
    start = to_work(pose.from_parts(np.eye(3), 1.0 - OFFSET), target.origin, source.origin)
    run, mixture = run_graduated(scan, target.surface, start, plan)
    return Outcome(run, mixture, scan, target.surface, source, target, plan)


def test_the_answer_is_in_the_frames_of_the_caller(outcome: Outcome) -> None:
    answer = outcome.registration((), {"total": 1.0}, {"effort": "best"})
    size = outcome.target.surface.diagonal
    at = outcome.source.origin
    expected = pose.from_parts(np.eye(3), -OFFSET)
    # Noise 3e-4 of the size over 2,700 points: a bound for a wrong frame, not of accuracy.
    assert pose.offset_between(answer.T_target_source, expected, at=at) <= 1e-3 * size
    assert answer.verdict.level == "accepted"
    assert answer.timings == {"total": 1.0}
    assert answer.settings["effort"] == "best"
    np.testing.assert_array_equal(answer.settings["centre"], outcome.target.origin)


def test_rms_and_inlier_fraction_are_those_of_the_last_pairs(outcome: Outcome) -> None:
    answer = outcome.registration((), {}, {})
    w, d = outcome.run.weights, outcome.run.pairs.distances
    assert answer.rms == pytest.approx(np.sqrt(np.average(d**2, weights=w)), rel=1e-12)
    assert answer.inlier_fraction == pytest.approx(w.mean(), rel=1e-12)


def test_the_covariance_is_about_the_middle_of_the_target(outcome: Outcome) -> None:
    covariance = outcome.registration((), {}, {}).covariance
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12, atol=0.0)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    # Where the target stands has no say: nothing of the far frame leaks into the numbers.
    far = dataclasses.replace(outcome, target=dataclasses.replace(outcome.target, origin=outcome.target.origin + 1e6))
    np.testing.assert_array_equal(far.registration((), {}, {}).covariance, covariance)


@pytest.mark.parametrize("status", ["no correspondences", "degenerate correspondences"])
def test_nothing_found_is_nan_and_failed(outcome: Outcome, status: str) -> None:
    nothing = dataclasses.replace(outcome, run=dataclasses.replace(outcome.run, status=status))
    answer = nothing.registration((), {}, {})
    assert np.isnan(answer.T_target_source).all()
    assert np.isnan(answer.covariance).all()
    assert np.isnan(answer.rms)
    assert answer.inlier_fraction == 0.0
    assert answer.observability == ()
    assert answer.verdict.level == "failed"


def test_a_run_without_a_record_found_nothing(outcome: Outcome) -> None:
    silent = dataclasses.replace(outcome, run=dataclasses.replace(outcome.run, history=()))
    assert silent.registration((), {}, {}).verdict.level == "failed"
