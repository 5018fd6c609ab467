"""Points of a cloud far from all others: left out beyond all doubt, named where they may be real."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from dqreg import Registration, Target, prepare_target, register, register_many
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.registration.problem.source import centre_source
from dqreg.registration.problem.strays import without_strays
from dqreg.rigid import pose
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
FIXED, MOVED = (sample_mesh(PART, 8_000, np.random.default_rng(seed)).points for seed in (1, 2))
T = pose.exp(np.array([0.05, -0.03, 0.04, 1.0, 2.0, -1.0]))
SCAN = pose.apply(pose.inverse(T), MOVED)
FAR = 1e9


def with_row(points: np.ndarray, row: list[float], at: int = 100) -> np.ndarray:
    return np.insert(points, at, row, axis=0)


@pytest.fixture(scope="module")
def expected() -> Registration:
    return register(SCAN, FIXED, "identity")


@pytest.mark.parametrize("distance", [3e4, FAR, 1e30])
def test_a_mark_for_a_missing_return_costs_nothing_and_is_named(expected: Registration, distance: float) -> None:
    # The point at 1e9 was accepted with a pose ten times as far off; with one at 1e12 there was none.
    for source, target in (
        (with_row(SCAN, [distance, 0, 0]), FIXED),
        (SCAN, with_row(FIXED, [distance, 0, 0])),
        (with_row(SCAN, [0, -distance, 0]), with_row(FIXED, [0, 0, distance], 0)),
    ):
        found = register(source, target, "identity")
        np.testing.assert_array_equal(found.T_target_source, expected.T_target_source)
        np.testing.assert_array_equal(found.covariance, expected.covariance)
        assert found.verdict.level == expected.verdict.level == "accepted"
        lost = [found.settings[f"{side}_dropped"] for side in ("source", "target")]
        assert lost == [len(source) - len(SCAN), len(target) - len(FIXED)]
        assert found.verdict.codes.count("stray_points") == sum(lost)
        assert f"{distance:.3g} from the middle" in found.verdict.reasons[-1]


def test_zeros_of_a_survey_far_from_its_origin_are_left_out() -> None:
    survey = FIXED + np.array([6e5, 5.4e6, 300.0])
    kept, strays = without_strays(PointCloud(np.insert(survey, [0, 17, 4_000], np.zeros((3, 3)), axis=0)))
    np.testing.assert_array_equal(kept.points, survey)
    assert strays is not None
    assert (strays.count, kept.dropped) == (3, 3)


def test_real_points_far_off_stay_and_those_that_set_the_lengths_are_named() -> None:
    size = float(np.abs(FIXED - np.median(FIXED, axis=0)).max())
    for times, code in ((3.0, ()), (9.0, ()), (40.0, ("stray_points",))):
        target = with_row(FIXED, [times * size, 0, 0])
        found = register(SCAN, target, "identity", effort="fast", search="never")
        assert found.settings["target_dropped"] == 0
        assert found.verdict.codes[1:] == code or found.verdict.level == "suspect"
        assert ("stray_points" in found.verdict.codes) == bool(code)


def test_more_than_a_per_mille_is_another_object() -> None:
    far = np.tile([FAR, 0.0, 0.0], (10, 1)) + FIXED[:10]
    kept, strays = without_strays(PointCloud(np.vstack([FIXED, far])))
    assert (len(kept), strays) == (len(FIXED) + 10, None)
    few = without_strays(PointCloud(with_row(FIXED[:80], [FAR, 0, 0], 40)))
    assert few[1] is None


def test_a_column_of_a_grid_is_seen_whatever_the_period() -> None:
    grid = np.random.default_rng(3).normal(size=(500, 1_000, 3))
    grid[:, 500] = FAR
    kept, strays = without_strays(PointCloud(grid.reshape(-1, 3)))
    assert strays is not None
    assert (strays.count, len(kept)) == (500, 499_500)


def test_what_belongs_to_a_point_goes_with_it() -> None:
    normals = np.random.default_rng(4).normal(size=(len(FIXED) + 1, 3))
    times = np.arange(len(FIXED) + 1.0)
    cloud = PointCloud(with_row(FIXED, [FAR, 0, 0]), normals, times=times)
    kept = centre_source(cloud, None, None, 0).cloud
    np.testing.assert_array_equal(kept.times, np.delete(times, 100))
    _, given = centre_source(cloud, None, None, 0).as_given()
    assert given is not None
    np.testing.assert_allclose(given, np.delete(cloud.normals, 100, axis=0))


def test_a_prepared_target_tells_of_them_from_a_file_too(tmp_path: Path) -> None:
    target = prepare_target(with_row(FIXED, [FAR, 0, 0]))
    target.save(tmp_path / "part.npz")
    for other in (Target.load(tmp_path / "part.npz"), pickle.loads(pickle.dumps(target))):
        assert other.indexed.strays == target.indexed.strays is not None
        assert other.indexed.geometry.dropped == 1


def test_many_scans_go_on_without_them() -> None:
    found = register_many([with_row(FIXED, [FAR, 0, 0]), SCAN], starts=[np.eye(4), np.eye(4)], effort="fast", seed=0)
    assert "stray_points" in found.verdict.codes
    assert "scan 0" in found.verdict.reasons[found.verdict.codes.index("stray_points")]
    assert np.abs(found.merged().points).max() < FAR
