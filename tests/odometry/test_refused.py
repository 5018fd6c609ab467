"""What becomes of frames whose place is refused, and of those after them. Truth: the poses that rays were cast from."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.compare.trust.drives import block, frame
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.shapes import joined
from dqreg.odometry import Odometry
from dqreg.rigid import pose

ROOM = [
    block((-6, -4, -0.1), (6, 4, 0)), block((-6, -4, 3), (6, 4, 3.1)), block((-6.1, -4, 0), (-6, 4, 3)),
    block((6, -4, 0), (6.1, 4, 3)), block((-6, -4.1, 0), (6, -4, 3)), block((-6, 4, 0), (6, 4.1, 3)),
    block((3, 1, 0), (4, 2, 1)),
]  # fmt: skip
SCREEN = block((-3.0, 1.5, 0.0), (0.5, 1.7, 2.6))


@pytest.fixture(scope="module")
def seen():
    """Frames of a sensor that goes on by 0.05 a frame, of the room with the screen, or without it."""
    rooms = {"with": joined(*ROOM, SCREEN), "without": joined(*ROOM)}

    def look(room, k):
        T = pose.from_parts(np.eye(3), [0.05 * k - 1.0, -0.5, 1.2])
        return frame(rooms[room], T, np.random.default_rng(k))

    return look


def test_a_frame_that_looked_through_the_map_stays_out_of_it(seen):
    odometry = Odometry()
    for k in range(3):
        assert odometry.register_frame(seen("with", k)).verdict.level == "accepted"
    before = len(odometry.local_map)
    result = odometry.register_frame(seen("without", 3))
    # That all turns were compared, and none fits as usual, is said beside it.
    assert set(result.verdict.codes) == {"looked_through", "falling_inlier_fraction"}
    assert result.verdict.level == "suspect"
    assert len(odometry.local_map) == before
    # Nothing hangs on it.
    result = odometry.register_frame(seen("with", 4))
    assert result.verdict.level == "accepted"
    assert len(odometry.local_map) > before


def test_no_frame_is_accepted_on_a_map_that_holds_one_that_looked_through_it(seen):
    odometry = Odometry()
    for k in range(3):
        odometry.register_frame(seen("with", k))
    codes = [odometry.register_frame(seen("without", k)).verdict.codes for k in range(3, 10)]
    assert "accepted" not in {code for each in codes for code in each}
    # Kept out as long as patience lasts, and what hangs on them says so then.
    assert all(each[0] == "untrusted_map" for each in codes[3:])


def test_a_frame_that_could_lie_elsewhere_as_well_stays_out_and_nothing_hangs_on_it():
    # Equal columns in both directions: without times any of them could be the next.
    drive, odometry = KINDS["drive-jump"].task(20000), Odometry()
    odometry.register_frame(drive.frames[0])
    before = len(odometry.local_map)
    result = odometry.register_frame(drive.frames[1])
    assert result.verdict.codes == ("alternative_poses",)
    assert "stamp=" in result.verdict.reasons[0]
    assert len(odometry.local_map) == before
    assert "untrusted_map" not in odometry.register_frame(drive.frames[2]).verdict.codes


def test_a_frame_of_the_floor_alone_stays_out_of_the_map_and_nothing_hangs_on_it(seen):
    # A cover over the sensor, dust: its place is not known, and the map does without it.
    odometry = Odometry(map_search="never")
    for k in range(3):
        odometry.register_frame(seen("with", k))
    before = len(odometry.local_map)
    for k in (3, 4):
        points = seen("with", k)
        result = odometry.register_frame(points[points[:, 2] < -1.15])
        assert result.verdict.codes[0] == "unconstrained"
        assert len(odometry.local_map) == before
        # Nothing but the motion tells its place: constant velocity, within a fraction of a voxel.
        np.testing.assert_allclose(result.T_target_source[:3, 3], [0.05 * k, 0.0, 0.0], atol=0.15)
    for k in (5, 6):
        result = odometry.register_frame(seen("with", k))
        assert result.verdict.level == "accepted"
        np.testing.assert_allclose(result.T_target_source[:3, 3], [0.05 * k, 0.0, 0.0], atol=0.02)


def test_what_goes_on_leaving_a_motion_free_enters_the_map_after_a_while_and_says_so(seen):
    # A corridor after a room: without it nothing would be known of the next frames.
    odometry = Odometry(patience=2, map_search="never")
    for k in range(3):
        odometry.register_frame(seen("with", k))
    floors = [points[points[:, 2] < -1.15] for points in (seen("with", k) for k in range(3, 6))]
    codes = [odometry.register_frame(points).verdict.codes for points in floors]
    assert [each[0] for each in codes] == ["unconstrained"] * 3
    result = odometry.register_frame(seen("with", 6))
    assert result.verdict.codes[0] == "untrusted_map"
    assert "prediction=" in result.verdict.reasons[0]


def test_after_a_frame_of_the_floor_alone_velocity_does_not_choose_between_equal_columns():
    # The sensor jumps by a period right after it, whatever the stamps say.
    drive, odometry = KINDS["drive-jump"].task(20_150), Odometry(map_search="never")
    jump = len(drive.frames) // 2
    for k, (points, T) in enumerate(zip(drive.frames, drive.poses, strict=True)):
        seen = points[points[:, 2] < -1.15] if k == jump - 1 else points
        result = odometry.register_frame(seen, stamp=0.1 * k)
        right = np.linalg.norm(result.T_target_source[:3, 3] - T[:3, 3]) <= drive.allowed
        assert right or result.verdict.level != "accepted"
