"""Odometry as a node needs it: predictions, a map that stays, saving and finding again, bounded memory."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg.errors import InputError
from dqreg.odometry import Odometry
from dqreg.odometry.prediction import Prediction
from dqreg.rigid import pose, twist


def corridor(x: float, rng: np.random.Generator) -> np.ndarray:
    """A frame at x in a corridor without features, 4 wide and 3 high: nothing constrains x."""
    points = rng.uniform(-1, 1, (4000, 3)) * [12.0, 2.0, 1.5]
    side = np.arange(4000) % 4
    points[side < 2, 1] = np.where(side[side < 2] == 0, -2.0, 2.0)
    points[side >= 2, 2] = np.where(side[side >= 2] == 2, -1.5, 1.5)
    return points + rng.normal(0, 0.01, points.shape)


def test_a_corridor_is_followed_with_wheels_and_told_without():
    # Truth: the frames differ by the noise alone, so x is what the wheels say, and nothing else can be.
    sigma = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02]) ** 2
    results = {}
    for wheels in (False, True):
        rng, odometry = np.random.default_rng(0), Odometry()
        for step in range(5):
            T = pose.from_parts(np.eye(3), [0.3 * step, 0.0, 0.0])
            options = {"prediction": T, "prediction_covariance": sigma} if wheels and step else {}
            results[wheels] = odometry.register_frame(corridor(0.3 * step, rng), **options)
    assert "unconstrained" in results[False].verdict.codes
    assert np.isnan(results[False].covariance).any()
    told = results[True]
    assert told.verdict.level == "accepted"
    assert told.verdict.codes == ("accepted", "held_by_prediction")
    np.testing.assert_allclose(told.T_target_source[:3, 3], [1.2, 0.0, 0.0], atol=0.02)
    # Along the corridor the wheels alone, across it the frame.
    deviations = np.sqrt(np.diag(told.covariance)[3:])
    assert deviations[0] == pytest.approx(0.02, rel=0.05)
    assert deviations[1:].max() < 0.01


@pytest.mark.parametrize("seed", [3, 9, 19, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (6, 15))])
def test_a_frame_comes_to_rest_along_a_corridor(seed):
    # Truth: the noise of the map's normals tells nothing of x, where a frame would slide for ever; wheels do.
    sigma = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02]) ** 2
    for wheels in (False, True):
        rng, odometry = np.random.default_rng(seed), Odometry()
        for step in range(4):
            T = pose.from_parts(np.eye(3), [0.3 * step, 0.0, 0.0])
            options = {"prediction": T, "prediction_covariance": sigma} if wheels and step else {}
            result = odometry.register_frame(corridor(0.3 * step, rng), **options)
            assert not step or result.status == "converged"
            assert ("unconstrained" in result.verdict.codes) == (not wheels and step > 0)
            assert (result.verdict.level == "accepted") == (wheels or step == 0)
            if step and wheels:
                # Before both are weighed: the frame itself has not slid.
                assert abs(result.history[-1].T_target_source[0, 3] - 0.3 * step) < 5e-3


def test_a_prediction_and_a_pose_are_weighed_as_two_gaussians():
    # By hand: along x, information 4 at 5 and 1 at 6 give 5.2 with variance 1/5. The prediction turns about its own
    # place, a lever of 1 from the frame's: its information about that, [[1, 1], [1, 2]] of a shift across and a turn,
    # and 4 of each by the frame have the inverse [[6, -1], [-1, 5]] / 29, with the other sign along the other axis.
    T = pose.from_parts(np.eye(3), [5.0, 0.0, 0.0])
    expected = Prediction.of(pose.from_parts(np.eye(3), [6.0, 0.0, 0.0]), np.eye(6))
    found, covariance = expected.fused(T, 4.0 * np.eye(6))
    np.testing.assert_allclose(found[:3, 3], [5.2, 0.0, 0.0], atol=1e-12)
    by_hand = np.diag([1 / 5, 5 / 29, 5 / 29, 1 / 5, 6 / 29, 6 / 29])
    by_hand[1, 5] = by_hand[5, 1] = 1 / 29
    by_hand[2, 4] = by_hand[4, 2] = -1 / 29
    np.testing.assert_allclose(covariance, by_hand, atol=1e-12)
    # A prediction of a turned sensor pulls it about its own place.
    turned = Prediction.of(T @ twist.exp([0, 0, 0.1, 0, 0, 0]), 1e-6 * np.eye(6))
    found, _ = turned.fused(T, np.zeros((6, 6)))
    np.testing.assert_allclose(found, turned.T_map_frame, atol=1e-9)


def test_wheels_that_contradict_the_frame_are_not_overruled():
    # The corridor is 4 wide: a place 0.6 across, sigma 0.02, is excluded by its walls.
    rng, odometry = np.random.default_rng(0), Odometry()
    odometry.register_frame(corridor(0.0, rng))
    sigma = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02]) ** 2
    across = pose.from_parts(np.eye(3), [0.3, 0.6, 0.0])
    told = odometry.register_frame(corridor(0.3, rng), prediction=across, prediction_covariance=sigma)
    assert told.verdict.level == "suspect"
    assert "contradicting_prediction" in told.verdict.codes


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"prediction_covariance": np.eye(6)}, "needs a prediction"),
        ({"prediction": np.eye(4), "prediction_covariance": np.eye(3)}, "6x6 matrix"),
        ({"prediction": np.eye(4), "prediction_covariance": np.zeros((6, 6))}, "variances above 0"),
        ({"prediction": np.eye(3)}, "prediction"),
    ],
)
def test_predictions_that_are_none_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        Odometry().register_frame(np.zeros((0, 3)), **options)


def test_a_saved_map_is_followed_without_change_and_the_sensor_found_in_it(jerky, tmp_path):
    odometry = Odometry()
    for frame in jerky.frames[:6]:
        odometry.register_frame(frame)
    odometry.save(tmp_path / "hall.npz")
    again = Odometry.load(tmp_path / "hall.npz")
    before = again.local_map
    assert {tuple(p) for p in before} == {tuple(p) for p in odometry.local_map}
    # Truth: the poses that the rays were cast from, in the frame of the first.
    truth = pose.inverse(jerky.truth[0]) @ jerky.truth
    result = again.register_frame(jerky.frames[6], insert=False)
    assert result.verdict.level == "accepted"
    assert np.abs(result.T_target_source - truth[6]).max() < 0.05
    np.testing.assert_array_equal(again.local_map, before)
    # Carried somewhere else: from no pose.
    carried = Odometry.load(tmp_path / "hall.npz")
    found = carried.relocalise(jerky.frames[3])
    assert found.verdict.level == "accepted"
    assert np.abs(carried.last_pose - truth[3]).max() < 0.05
    # From about where it was put: no search.
    put = Odometry.load(tmp_path / "hall.npz")
    found = put.relocalise(jerky.frames[3], start=truth[3] @ twist.exp([0.02, -0.02, 0.03, 0.1, 0.1, -0.05]))
    assert (found.verdict.level, found.settings["start"]) == ("accepted", "given")
    assert np.abs(put.last_pose - truth[3]).max() < 0.05
    with pytest.raises(InputError, match="no map"):
        Odometry().relocalise(jerky.frames[0])


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"1 2 3"])
def test_what_is_no_map_is_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.npz"):
        Odometry.load(tmp_path / "a.npz")
    with pytest.raises(InputError, match="no map to save"):
        Odometry().save(tmp_path / "b.npz")


def test_a_map_of_a_newer_program_is_named_with_what_to_do(jerky, tmp_path):
    odometry = Odometry()
    odometry.register_frame(jerky.frames[0])
    odometry.save(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as held:
        arrays = dict(held)
    header = json.loads(arrays["header"].tobytes())

    def written(**changes):
        arrays["header"] = np.frombuffer(json.dumps({**header, **changes}).encode(), dtype=np.uint8)
        np.savez(tmp_path / "other.npz", **arrays)
        return tmp_path / "other.npz"

    with pytest.raises(
        InputError, match=r"other\.npz is no map.* version 7, and versions 1 to 3 are read.*update dqreg"
    ):
        Odometry.load(written(version=7, lengths={**header["lengths"], "unheard_of": 1.0}))
    # Of old, with noise or without.
    lengths = {name: value for name, value in header["lengths"].items() if name != "noise"}
    for old in (written(version=1), written(version=1, lengths=lengths)):
        np.testing.assert_array_equal(Odometry.load(old).local_map, odometry.local_map)


def test_history_is_bounded_and_a_reset_begins_anew(jerky):
    odometry = Odometry(history=3)
    for number, frame in enumerate(jerky.frames[:5]):
        odometry.register_frame(frame[::3], stamp=0.1 * number)
    assert odometry.trajectory.times.tolist() == pytest.approx([0.2, 0.3, 0.4])
    assert len(odometry.poses) == 3
    odometry.reset(start=pose.from_parts(np.eye(3), [1.0, 2.0, 3.0]))
    assert (len(odometry.poses), len(odometry.local_map)) == (0, 0)
    assert odometry.register_frame(jerky.frames[0][::3]).T_target_source[:3, 3].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match="history"):
        Odometry(history=0)


def test_the_first_frame_says_why_it_has_no_information(jerky):
    """As the how-to's loop skips it: the frames after it have some."""
    odometry = Odometry()
    frames = [odometry.register_frame(frame) for frame in jerky.frames[:2]]
    assert ["first_frame" in frame.verdict.codes for frame in frames] == [True, False]
    for ask in (lambda first: first.information, lambda first: first.information_in("source")):
        with pytest.raises(InputError, match=r"the first frame defines the map's frame.* skip the frame"):
            ask(frames[0])
    assert not frames[0].covariance_in("source").any()
    assert np.linalg.eigvalsh(frames[1].information_in("source")).min() > 0.0


def test_what_cannot_be_pickled_points_to_what_can_be_saved(jerky, tmp_path):
    """Before the first frame it can, as it always could: then it is its settings."""
    odometry = Odometry(voxel_size=0.3, start=pose.from_parts(np.eye(3), [1.0, 2.0, 3.0]))
    again = pickle.loads(pickle.dumps(odometry))
    assert again.settings == odometry.settings
    np.testing.assert_array_equal(again.last_pose, odometry.last_pose)
    odometry.register_frame(jerky.frames[0])
    odometry.save(tmp_path / "map.npz")
    for begun in (odometry, Odometry.load(tmp_path / "map.npz")):
        for take in (pickle.dumps, copy.copy, copy.deepcopy):
            with pytest.raises(InputError, match=r"neither pickled nor copied: Odometry\.save"):
                take(begun)
    odometry.reset()
    pickle.dumps(odometry)
