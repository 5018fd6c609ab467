"""What the rays of two scans say: exact, as the rooms and the places of the scanner are made."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry.rays import Rays
from dqreg.rigid import pose
from dqreg.synth.many_views import ManyViews, room_stops
from dqreg.trust.limits import MAX_RAY_PASS_SHARE, MIN_RAY_MEETING_SHARE, RAY_CONFLICT_SHARE
from dqreg.trust.rays import BothRays, Met
from tests.strategies import FloatArray

HERE, NOISE = np.zeros(3), 0.005
# A half-turn about the middle of the room leaves its walls in place.
HALF = np.diag([-1.0, -1.0, 1.0, 1.0])


def room(seed: int, rings: int) -> ManyViews:
    return room_stops(2, rings=rings, rng=np.random.default_rng(seed))


def rays_of(points: FloatArray) -> Rays:
    found = Rays.of(points, HERE, is_known=False)
    assert found is not None
    return found


def met(made: ManyViews, scans: tuple[FloatArray, FloatArray]) -> Met:
    """At the true pose, and after the half-turn."""
    one, other = made.T_world_scan
    poses = np.stack([pose.inverse(one) @ T @ other for T in (np.eye(4), HALF)])
    return BothRays(rays_of(scans[1]), rays_of(scans[0])).met(poses, NOISE, 6_000)


@pytest.mark.parametrize("rings", [16, 32, 64])
@pytest.mark.parametrize("seed", [240, 241, 242])
def test_the_true_pose_of_a_room_is_told_from_its_half_turn(seed: int, rings: int) -> None:
    made = room(seed, rings)
    found = met(made, (made.scans[0], made.scans[1]))
    assert found.agree
    assert found.through[0] <= 0.1 * MAX_RAY_PASS_SHARE
    assert found.through[1] > RAY_CONFLICT_SHARE


def test_what_a_field_of_view_cuts_off_says_nothing() -> None:
    made = room(243, 48)
    one, other = made.scans
    # The faces of either end elsewhere: half of the azimuths, and all above the horizon, of each.
    narrow = one[(one[:, 0] > 0.0)], other[other[:, 2] < 0.0]
    assert met(made, narrow).through[0] <= 0.1 * MAX_RAY_PASS_SHARE


def test_a_ring_that_is_missing_says_nothing() -> None:
    made = room(244, 32)
    gaps = []
    for scan in made.scans:
        elevation = np.arcsin(scan[:, 2] / np.linalg.norm(scan, axis=1))
        gaps.append(scan[~((elevation > -0.2) & (elevation < -0.05))])
    assert met(made, (gaps[0], gaps[1])).through[0] <= 0.1 * MAX_RAY_PASS_SHARE


def test_points_that_are_even_on_a_body_are_no_rays() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (20_000, 3)) * [4.0, 1.0, 1.0]
    side = rng.choice(3, len(points), p=[1.0 / 9.0, 4.0 / 9.0, 4.0 / 9.0])
    rows = np.arange(len(points))
    points[rows, side] = np.sign(points[rows, side]) * np.array([4.0, 1.0, 1.0])[side]
    found = Rays.of(points, HERE, is_known=False)
    assert found is None or not found.is_even
    # A cube is no longer than it is wide.
    assert Rays.of(points * [0.25, 1.0, 1.0], HERE, is_known=False) is None


def test_nothing_is_said_from_a_place_outside() -> None:
    made = room(245, 32)
    assert Rays.of(made.scans[0], np.array([0.0, 0.0, 40.0]), is_known=False) is None


def test_few_points_are_no_rays() -> None:
    made = room(245, 32)
    assert Rays.of(made.scans[0][::600], HERE, is_known=False) is None


def test_what_is_seen_of_another_room_is_little() -> None:
    one, other = room(246, 32), room_stops(2, rings=32, rng=np.random.default_rng(247))
    # Beside each other: what either shows is out of the other's view, or behind its walls.
    T = np.eye(4)
    T[0, 3] = 9.0
    found = BothRays(rays_of(other.scans[0]), rays_of(one.scans[0])).met(T[None], NOISE, 6_000)
    assert found.alike[0] < MIN_RAY_MEETING_SHARE
    assert not found.agree
