"""LiDAR stops of which nobody says where the scanner stood: a scan of another room is left out and named."""

import numpy as np
import pytest

import dqreg
from dqreg._arrays import FloatArray
from dqreg.multiway.scans.scans import read_views
from dqreg.multiway.visibility.passed_rays import MAX_PASSED_SHARE, PassedRays
from dqreg.synth.many_views import ManyViews, room_stops, turntable_views
from dqreg.synth.parts import bracket

STOPS, RINGS = 4, 16
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def room() -> ManyViews:
    return room_stops(STOPS, rings=RINGS, rng=np.random.default_rng(20750))


def other_room() -> tuple[FloatArray, FloatArray]:
    """The same walls with other furniture."""
    other = room_stops(1, rings=RINGS, rng=np.random.default_rng(20751))
    return other.scans[0], other.T_world_scan[0]


def mirrored(room: ManyViews) -> tuple[FloatArray, FloatArray]:
    """The walls are the same in a mirror, the furniture is not."""
    return room.scans[1] * [-1.0, 1.0, 1.0], MIRROR @ room.T_world_scan[1] @ MIRROR


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("other room", 2),
        pytest.param("mirrored", 0, marks=pytest.mark.soak),
        pytest.param("other room", 0, marks=pytest.mark.soak),
        pytest.param("mirrored", 2, marks=pytest.mark.soak),
    ],
)
def test_a_scan_through_which_rays_of_the_others_passed_is_left_out_and_named(
    kind: str, place: int, room: ManyViews
) -> None:
    foreign, T_foreign = other_room() if kind == "other room" else mirrored(room)
    # Three stops of the room: one that stands in the way of its own mirror image is left out, or any.
    scans, poses = list(room.scans), list(room.T_world_scan)
    del scans[1], poses[1]
    scans.insert(place, foreign)
    poses.insert(place, T_foreign)
    result = dqreg.register_many(scans, starts=poses, effort="fast", workers=1)
    assert result.verdict.level != "accepted"
    assert place not in result.placed
    assert "scan_left_out" in result.verdict.codes
    assert any(f"scan {place} " in str(reason) for reason in result.verdict.reasons)


def test_right_stops_are_accepted_without_a_word(room: ManyViews) -> None:
    result = dqreg.register_many(list(room.scans), starts=room.T_world_scan, effort="fast", workers=1)
    assert result.verdict.codes == ("accepted",)
    assert len(result.placed) == STOPS


def test_what_rays_passed_is_told_of_the_scan_that_does_not_belong(room: ManyViews) -> None:
    foreign, T_foreign = other_room()
    rays = PassedRays.of(read_views([*room.scans, foreign], 0))
    assert rays is not None
    shares = rays.shares(np.concatenate([room.T_world_scan, T_foreign[None]]))
    assert shares.argmax() == STOPS
    assert shares[STOPS] > MAX_PASSED_SHARE
    alone = np.concatenate([room.T_world_scan, np.full((1, 4, 4), np.nan)])
    # Rays of right poses pass nothing: a hundredth of what is allowed.
    assert rays.shares(alone).max() < 0.1 * MAX_PASSED_SHARE
    assert not rays.contradictions(alone).any()


@pytest.mark.parametrize("frame", ["scanner", "centred"])
def test_views_of_a_part_are_no_rays_from_a_place_amid_it(frame: str) -> None:
    made = turntable_views(bracket(), 8, pixels=60, rng=np.random.default_rng(20752))
    scans = made.scans if frame == "scanner" else [points - points.mean(axis=0) for points in made.scans]
    assert PassedRays.of(read_views(scans, 0)) is None
