"""A sensor that turned while no frame was seen. Truth: the poses that rays were cast from."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.compare.trust.drives import block, frame
from dqreg.compare.trust.shapes import joined
from dqreg.odometry import Odometry
from dqreg.odometry.starts import turns
from dqreg.rigid import pose

# A hall of 10 by 7, and what stands in it: a half-turn about its middle puts the walls onto themselves.
HALL = [
    block((-5, -3.5, -0.1), (5, 3.5, 0)), block((-5, -3.5, 3), (5, 3.5, 3.1)), block((-5.1, -3.5, 0), (-5, 3.5, 3)),
    block((5, -3.5, 0), (5.1, 3.5, 3)), block((-5, -3.6, 0), (5, -3.5, 3)), block((-5, 3.5, 0), (5, 3.6, 3)),
]  # fmt: skip
CABINETS = [block((2.5, -3.5, 0), (3.5, -2.8, 1.9)), block((-4.8, 2.0, 0), (-4.0, 3.2, 1.2))]
ASIDE, MIDDLE = (0.6, -0.4, 1.2), (-0.05, -0.03, 1.2)


def placed(start, yaw_deg, k):
    T = pose.exp(np.r_[0.0, 0.0, np.deg2rad(yaw_deg), 0.0, 0.0, 0.0])
    T[:3, 3] = np.add(start, (0.03 * k, 0.02 * k, 0.0))
    return T


def drive(pieces, yaws_deg, stamps, start=ASIDE):
    """Results of a sensor that looks at a hall under some yaws, and how far off each pose is, in degrees."""
    scene, rng, odometry = joined(*pieces), np.random.default_rng(3), Odometry()
    poses = [placed(start, yaw, k) for k, yaw in enumerate(yaws_deg)]
    results = [odometry.register_frame(frame(scene, T, rng), stamp=t) for T, t in zip(poses, stamps, strict=True)]
    off = [
        pose.angle_between(pose.inverse(poses[0]) @ T, result.T_target_source)
        for T, result in zip(poses, results, strict=True)
    ]
    return results, np.rad2deg(off)


@pytest.mark.parametrize("yaw_deg", [180.0, 126.0])
def test_a_turn_in_an_outage_is_found_whatever_it_is(yaw_deg):
    results, off = drive([*HALL, *CABINETS], [0, 2, 4, 4 + yaw_deg, 6 + yaw_deg], [0.0, 0.1, 0.2, 3.2, 3.3])
    assert [result.verdict.level for result in results] == ["accepted"] * 5
    assert max(off) < 0.3


@pytest.mark.parametrize("cabinet", CABINETS)
def test_a_half_turn_within_one_step_is_found_where_the_frame_looked_through_the_map(cabinet):
    # Without a gap in time nothing asks for it but a cabinet that is not there.
    results, off = drive([*HALL, cabinet], [0, 2, 4, 6, 186, 188], 0.1 * np.arange(6), MIDDLE)
    assert [result.verdict.level for result in results] == ["accepted"] * 6
    assert max(off) < 0.3


def test_the_half_turn_of_a_place_is_not_accepted_where_the_frame_looked_through_the_map():
    # The best of all turns, with 80 % inliers after 95 %: the right one is too far off for its start.
    scene, rng, odometry = joined(*HALL, *CABINETS), np.random.default_rng(3), Odometry()
    poses = [*(placed(ASIDE, 2 * k, k) for k in range(4)), placed(np.add(ASIDE, (-2.4, 0.0, 0.0)), -35, 4)]
    for number, T in enumerate(poses):
        result = odometry.register_frame(frame(scene, T, rng), stamp=0.1 * number)
    truth = pose.inverse(poses[0]) @ poses[-1]
    is_right = np.rad2deg(pose.angle_between(truth, result.T_target_source)) < 0.3
    assert is_right or result.verdict.level == "suspect"


def test_a_carried_sensor_is_found_where_its_half_turn_looks_through_a_cabinet():
    # The half-turn has 95 % of the inliers of the right pose, and no cabinet where the map has one.
    scene, rng, odometry = joined(*HALL, *CABINETS), np.random.default_rng(3), Odometry()
    poses = [*(placed(ASIDE, 2 * k, k) for k in range(4)), placed(np.add(ASIDE, (-2.15, -0.01, 0.0)), -54, 4)]
    for number, T in enumerate(poses):
        result = odometry.register_frame(frame(scene, T, rng), stamp=0.1 * number)
    assert result.verdict.level == "accepted"
    assert np.rad2deg(pose.angle_between(pose.inverse(poses[0]) @ poses[-1], result.T_target_source)) < 0.3


def test_a_half_turn_that_nothing_tells_from_none_is_named():
    results, _ = drive(HALL, [0, 2, 4, 184], [0.0, 0.1, 0.2, 3.2], MIDDLE)
    assert results[-1].verdict.level == "suspect"
    assert "alternative_poses" in results[-1].verdict.codes
    other = results[-1].alternatives[0].T_target_source
    assert np.rad2deg(pose.angle_between(results[-1].T_target_source, other)) > 178.0


def test_without_a_gap_a_frame_that_fits_as_usual_asks_for_no_other_turn(monkeypatch):
    asked = []
    monkeypatch.setattr(
        "dqreg.odometry.unseen_rotations.candidates", lambda *given: asked.append(given) or turns(1.0, 1.0)
    )
    results, _ = drive([*HALL, *CABINETS], [0, 2, 4, 6], [0.0, 0.1, 0.2, 0.3])
    assert [result.verdict.level for result in results] == ["accepted"] * 4
    assert not asked


def test_the_half_turn_of_a_hall_with_other_furniture_is_named():
    # What stands there now tells nothing: the walls fit after either turn.
    boxes = [block((2.5, -3.4, 0), (3.2, -2.8, 1)), block((-4.8, 2.0, 0), (-4.2, 2.8, 1))]
    others = [block((-3.0, -3.4, 0), (-2.4, -2.8, 1)), block((3.5, 1.5, 0), (4.1, 2.1, 1))]
    T_world_map, T = placed((0.3, -0.2, 1.2), 0.0, 0), placed((0.3, -0.2, 1.2), 20.0, 5)
    odometry, rng = Odometry(), np.random.default_rng(5)
    odometry.register_frame(frame(joined(*HALL, *boxes), T_world_map, rng))
    seen = frame(joined(*HALL, *others), T, rng)
    result = odometry.relocalise(seen)
    assert result.verdict.codes == ("alternative_poses",)
    turn = pose.angle_between(result.T_target_source, result.alternatives[0].T_target_source)
    assert np.rad2deg(turn) > 178.0
    # Where the sensor is said to be, nothing else is meant.
    assert odometry.relocalise(seen, pose.inverse(T_world_map) @ T).verdict.level == "accepted"
    assert odometry.relocalise(frame(joined(*HALL, *boxes), T, rng)).verdict.level == "accepted"
