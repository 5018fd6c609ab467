from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import PointCloud
from dqreg.rigid import pose
from dqreg.synth.many_views import room_stops
from dqreg.trust.free_space import DepthImage, Seen, looked_through
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE
from tests.strategies import FloatArray

BALLS = ((-1.5, -0.5, 4.0, 0.8), (1.2, 0.6, 5.0, 0.9), (0.4, -1.0, 3.5, 0.4))


def seen_from(eye: FloatArray, side: int = 70) -> FloatArray:
    """What a depth camera sees of three balls before a wall and above a floor, in its own frame."""
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, side), np.linspace(-0.5, 0.5, side))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        floor = (-1.5 - eye[1]) / rays[:, 1]
    ranges = np.minimum((7.0 - eye[2]) / rays[:, 2], np.where(floor > 0.0, floor, np.inf))
    for *centre, radius in BALLS:
        b = rays @ (np.array(centre) - eye)
        inside = b**2 - np.sum((np.array(centre) - eye) ** 2) + radius**2
        ranges = np.where(inside > 0.0, np.minimum(ranges, b - np.sqrt(np.maximum(inside, 0.0))), ranges)
    return rays * ranges[:, None]


EYE = np.array([0.6, 0.3, -0.4])
HERE, THERE = seen_from(np.zeros(3)), seen_from(EYE)
# The frame of the first camera is that of the scene.
TRUTH = pose.from_parts(np.eye(3), EYE)


def turned(degrees: float) -> FloatArray:
    """The true pose rotated about the middle of the scene."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return pose.about(pose.from_parts(turn, np.zeros(3)), HERE.mean(axis=0)) @ TRUTH


def share(T: FloatArray, origin: FloatArray | float = 0.0, **viewpoints: FloatArray | None) -> float:
    at = np.zeros(3) + origin
    sides = Seen(THERE, viewpoints.get("source"), at), Seen(HERE, viewpoints.get("target"), at)
    return looked_through(*sides, T, 0.15 / max(side.spacing for side in sides))


def test_the_true_pose_puts_nothing_where_a_camera_looked_through() -> None:
    assert share(TRUTH) <= 0.2 * DEPTH_CONFLICT_SHARE


@pytest.mark.parametrize("degrees", [20.0, 40.0, 180.0])
def test_a_wrong_pose_does(degrees: float) -> None:
    assert share(turned(degrees)) > 4.0 * DEPTH_CONFLICT_SHARE


def test_a_place_that_is_no_viewpoint_is_not_asked() -> None:
    # Inside of the points, and beside them where balls hide the wall.
    assert np.isnan(share(TRUTH, HERE.mean(axis=0)))
    assert np.isnan(share(TRUTH, np.array([6.0, 0.0, 5.0])))
    # One place that is given will do.
    assert share(TRUTH, HERE.mean(axis=0), target=np.zeros(3)) <= 0.2 * DEPTH_CONFLICT_SHARE


@pytest.mark.parametrize(("seed", "rings", "pair"), [(100, 48, (0, 2)), (103, 48, (1, 2))])
def test_a_room_turned_by_half_is_told_by_what_stands_before_its_furniture(seed, rings, pair) -> None:
    # Exact: the room and the places of the scanner are made; a half-turn about its middle leaves its walls in place.
    made = room_stops(3, rings=rings, rng=np.random.default_rng(seed))
    one, other = (made.scans[k] for k in pair)
    T_world_one, T_world_other = (made.T_world_scan[k] for k in pair)
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    sides = Seen(other, None, np.zeros(3)), Seen(one, None, np.zeros(3))
    gaps = [looked_through(*sides, pose.inverse(T_world_one) @ T @ T_world_other, 4.0) for T in (np.eye(4), half)]
    assert gaps[0] < 0.1 * DEPTH_CONFLICT_SHARE
    assert gaps[1] > DEPTH_CONFLICT_SHARE


def test_scans_of_several_places_have_no_viewpoint_at_their_origin() -> None:
    gaps, seen = 0.02, Seen(THERE, None, np.zeros(3))
    wrong = turned(20.0)
    for one_place, told in ((True, True), (False, False)):
        merged = Seen(HERE, None, np.zeros(3), one_place=one_place)
        assert np.isfinite(looked_through(seen, merged, wrong, gaps)) == told
        # Where the scanner of the other side stood is known, and what it looked through.
        assert looked_through(Seen(THERE, np.zeros(3), np.zeros(3)), merged, wrong, gaps) > DEPTH_CONFLICT_SHARE


def test_it_has_no_unit() -> None:
    far = pose.from_parts(np.eye(3), 1e3 * (EYE + np.array([0.0, 0.0, -0.5])))
    sides = Seen(1e3 * THERE, None, np.zeros(3)), Seen(1e3 * HERE, None, np.zeros(3))
    near = pose.from_parts(np.eye(3), EYE + np.array([0.0, 0.0, -0.5]))
    gaps = 150.0 / max(side.spacing for side in sides)
    assert looked_through(*sides, far, gaps) == pytest.approx(share(near), abs=1e-3)


def test_an_image_counts_what_is_in_front_and_leaves_out_what_is_behind() -> None:
    image = DepthImage.of(HERE, np.zeros(3))
    # Some are before a ball of which the edge is as near.
    assert image.compared(0.5 * HERE, 0.15)[0] >= 0.95 * len(HERE)
    assert image.compared(2.0 * HERE, 0.15) == (0, 0)
    assert image.compared(HERE, 0.15)[0] == 0
    # Beyond the edges nothing was seen.
    assert image.compared(HERE * [1.0, 1.0, -1.0], 0.15) == (0, 0)


def test_two_depth_images_are_accepted_and_a_wrong_pose_is_not() -> None:
    # A tenth of the rays met nothing.
    nothing = np.zeros((len(HERE) // 10, 3))
    right = dqreg.register(
        np.vstack([THERE, nothing]), PointCloud(np.vstack([HERE, nothing])), TRUTH, effort="fast", search="never"
    )
    assert right.verdict.level == "accepted"
    # Locked, so that it cannot leave it.
    wrong = dqreg.register(THERE, PointCloud(HERE), turned(30.0), effort="fast", dof="tx")
    assert wrong.verdict.level == "suspect"
    assert "looked_through" in wrong.verdict.codes
