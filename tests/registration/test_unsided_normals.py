"""Given normals whose signs are arbitrary count as planes without a side; those that have one stay witnesses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.opening import as_geometry
from dqreg.registration.problem.source import centre_source
from dqreg.rigid import pose
from dqreg.synth import demo_case, load_case
from tests.strategies import FloatArray

POINTS, NOISE = 6_000, 5e-4
TURN = pose.exp([0.05, -0.06, 0.04, 0.0, 0.0, 0.0])


@cache
def part() -> dqreg.Mesh:
    found = as_geometry(load_case(demo_case()).part, "part")
    assert isinstance(found, dqreg.Mesh)
    return found


@cache
def scanned(seed: int) -> tuple[FloatArray, FloatArray]:
    """Points of all sides of a part, with noise, and their planes, outward."""
    rng = np.random.default_rng(seed)
    cloud = sample_mesh(part(), POINTS, rng)
    points = cloud.points + NOISE * part().diagonal * rng.normal(size=(POINTS, 3))
    planes = fit_planes(NeighbourTree(points), points, points).normals
    return points, planes * np.where((planes * cloud.normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]


def signs(kind: str, points: FloatArray) -> FloatArray:
    if kind == "at random":
        return np.random.default_rng(7).choice([-1.0, 1.0], (len(points), 1))
    if kind == "four in five right":
        return np.where(np.random.default_rng(7).uniform(size=(len(points), 1)) < 0.2, -1.0, 1.0)
    # The same over patches, as a plane fit leaves them.
    return np.sign(np.sin(40.0 * points / part().diagonal).prod(axis=1))[:, None]


def placed(kind: str) -> dqreg.PointCloud:
    points, planes = scanned(0)
    T = pose.inverse(TURN)
    return dqreg.PointCloud(pose.apply(T, points), signs(kind, points) * planes @ T[:3, :3].T)


@cache
def alone(against: str) -> FloatArray:
    """Pose of the points without normals, which are those of every kind."""
    bare = part() if against == "mesh" else scanned(1)[0]
    return dqreg.register(pose.apply(pose.inverse(TURN), scanned(0)[0]), bare, np.eye(4)).T_target_source


@pytest.mark.parametrize("against", ["mesh", "cloud"])
@pytest.mark.parametrize("kind", ["at random", "four in five right", "over patches"])
def test_arbitrary_signs_change_nothing(kind: str, against: str) -> None:
    points, planes = scanned(1)
    target = part() if against == "mesh" else dqreg.PointCloud(points, signs(kind, points) * planes)
    given = dqreg.register(placed(kind), target, np.eye(4))
    assert given.verdict.level == "accepted"
    assert given.settings["normals_oriented"] is False
    np.testing.assert_array_equal(given.T_target_source, alone(against))


def test_oriented_normals_are_kept_and_inside_out_is_a_doubt() -> None:
    points, planes = scanned(0)
    T = pose.inverse(TURN)
    out, inward = (dqreg.PointCloud(pose.apply(T, points), sign * planes @ T[:3, :3].T) for sign in (1.0, -1.0))
    found = dqreg.register(out, part(), np.eye(4), effort="fast")
    assert (found.verdict.level, found.settings["normals_oriented"]) == ("accepted", True)
    doubted = dqreg.register(inward, part(), np.eye(4), effort="fast")
    assert doubted.verdict.level == "suspect"
    assert "disagreeing_normals" in doubted.verdict.codes


def test_the_scan_is_written_with_the_normals_that_it_came_with() -> None:
    cloud = placed("at random")
    source = centre_source(cloud, None, None, 0)
    assert source.cloud.normals is None
    np.testing.assert_array_equal(source.as_given()[1], cloud.normals)
