"""Rings between two clouds: turns by a lobe are found in the clouds alone, and what only one fits is not accepted."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import dqreg
from dqreg.geometry import CloudSurface, PointCloud, sample_mesh
from dqreg.rigid import pose, twist
from dqreg.search.cloud_rings import ring_turns
from dqreg.search.tangent_planes import TangentPlanes
from tests.icp.scenes import bracket_mesh
from tests.strategies import FloatArray

LOBES, DEPTH, HEIGHT, NOISE, POINTS = 12, 0.04, 0.2, 5e-4, 9_000
# Lobes with a bolt hole: no turn puts more than one of them on another.
HOLES = (0, 1, 4)
# Askew, and off the origin.
PLACE = pose.exp(np.array([0.4, -0.7, 0.3, 0.5, -0.2, 0.8]))


def lobed(rng: np.random.Generator, *, holes: tuple[int, ...]) -> FloatArray:
    """A ring with lobes, seen from above and aside, with bolt holes in some of them."""
    angle, wall = rng.uniform(0.0, 2.0 * np.pi, 4 * POINTS), rng.random(4 * POINTS) < 0.4
    radius = 1.0 + DEPTH * np.cos(LOBES * angle)
    radius = np.where(wall, radius, radius * np.sqrt(rng.uniform(0.4, 1.0, len(angle))))
    height = np.where(wall, rng.uniform(0.0, HEIGHT, len(angle)), HEIGHT)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    kept = np.ones(len(points), dtype=bool)
    for k in holes:
        middle = 0.8 * np.array([np.cos(2.0 * np.pi * k / LOBES), np.sin(2.0 * np.pi * k / LOBES)])
        kept &= wall | (np.linalg.norm(points[:, :2] - middle, axis=1) > 0.12)
    points = points[kept][:POINTS]
    return pose.apply(PLACE, points + NOISE * rng.normal(size=points.shape))


def turned_by(lobes: float) -> FloatArray:
    """A turn about the axis of the ring where it lies."""
    turn = pose.exp(np.array([0.0, 0.0, 2.0 * np.pi * lobes / LOBES, 0.0, 0.0, 0.0]))
    return np.asarray(PLACE @ turn @ pose.inverse(PLACE))


@cache
def pair(holes: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(3)
    return lobed(rng, holes=holes), lobed(rng, holes=holes)


def test_the_turns_of_a_cloud_are_multiples_of_its_lobes() -> None:
    cloud = CloudSurface(PointCloud(pair(HOLES)[1]))
    turns = ring_turns(cloud, TangentPlanes(cloud))
    assert len(turns) == LOBES - 1
    # A turn either way comes first.
    sign = np.sign(twist.log(turns[0]) @ twist.log(turned_by(1.0)))
    points = pair(HOLES)[0][::50]
    for k, T in enumerate(turns, start=1):
        apart = np.linalg.norm(pose.apply(T, points) - pose.apply(turned_by(sign * k), points), axis=1)
        assert apart.max() < 0.01


def test_a_bracket_has_no_turns() -> None:
    cloud = CloudSurface(PointCloud(sample_mesh(bracket_mesh(), 6_000, np.random.default_rng(0)).points))
    assert not len(ring_turns(cloud, TangentPlanes(cloud)))


@pytest.mark.parametrize("lobes", [1.0, pytest.param(2.0, marks=pytest.mark.soak), 4.0])
def test_from_a_start_some_lobes_off_the_right_pose_is_the_answer_or_named(lobes: float) -> None:
    scan, target = pair(HOLES)
    start = turned_by(lobes) @ pose.exp(np.r_[0.0, 0.35, 0.0, 0.0, 0.0, 0.0])
    found = dqreg.register(scan, target, start, search="never")
    named = [] if found.verdict.level == "accepted" else [other.T_target_source for other in found.alternatives]
    assert min(pose.angle_between(T, np.eye(4)) for T in (found.T_target_source, *named)) < 0.01


def test_holes_tell_a_right_pose_from_all_turns() -> None:
    scan, target = pair(HOLES)
    # Half a lobe off and more: the start decides nothing.
    found = dqreg.register(scan, target, turned_by(0.0) @ pose.exp(np.r_[0.0, 0.3, 0.0, 0.0, 0.0, 0.0]), search="never")
    assert pose.angle_between(found.T_target_source, np.eye(4)) < 0.01
    assert found.verdict.level == "accepted"


def test_where_nothing_tells_the_lobes_apart_a_far_start_is_not_accepted() -> None:
    scan, target = pair(())
    start = turned_by(1.0) @ pose.exp(np.r_[0.0, 0.35, 0.0, 0.0, 0.0, 0.0])
    found = dqreg.register(scan, target, start, search="never")
    assert "alternative_poses" in found.verdict.codes
    angles = [pose.angle_between(other.T_target_source, found.T_target_source) for other in found.alternatives]
    assert min(angles) == pytest.approx(2.0 * np.pi / LOBES, abs=0.02)


def test_a_start_less_than_half_a_lobe_off_decides() -> None:
    scan, target = pair(())
    found = dqreg.register(scan, target, turned_by(0.2), search="never")
    assert pose.angle_between(found.T_target_source, np.eye(4)) < 0.01
    assert found.verdict.level == "accepted"
