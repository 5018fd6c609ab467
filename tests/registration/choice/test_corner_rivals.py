"""Other corners that a scan of a corner may be laid on: of cubes, blocks and prisms."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, sample_mesh
from dqreg.registration.choice.corner_rivals import (
    _cube_turns,
    _ends,
    _turned,
    beside_corners,
    corner_rivals,
    prism_turns,
)
from dqreg.registration.choice.fallback import BestPoses
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import NO_POSES
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.synth.parts import box
from tests.icp.scenes import bumpy_cloud
from tests.registration.scenes import fit_of, problem_of

CUBE, BLOCK = Mesh(*box((60.0, 60.0, 60.0))), Mesh(*box((100.0, 60.0, 40.0)))
NOISE = 0.02
ASKEW = pose.exp(np.array([0.4, -0.7, 0.2, 0.0, 0.0, 0.0]))[:3, :3]


def sides(order: int, shown: int) -> FloatArray:
    """Normals of an end of a prism, and of some of its sides."""
    angles = 2.0 * np.pi / order * np.arange(shown)
    return np.vstack([[0.0, 0.0, 1.0], np.column_stack([np.cos(angles), np.sin(angles), np.zeros(shown)])])


@pytest.mark.parametrize(("order", "shown"), [(6, 2), (6, 3), (8, 3), (12, 4), (5, 2), (3, 2)])
@pytest.mark.parametrize("frame", [np.eye(3), ASKEW])
def test_turns_of_a_prism_lay_its_sides_on_each_other(order: int, shown: int, frame: FloatArray) -> None:
    whole = np.vstack([sides(order, order), [[0.0, 0.0, -1.0]]]) @ frame.T
    turns = prism_turns(sides(order, shown) @ frame.T)
    # All of its own, at least: a triangle's are among those of a hexagon, whose sides include its.
    assert len(turns) >= 2 * order - 1
    for R in turns:
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        along = np.abs((whole @ R.T) @ whole.T).max(axis=1)
        np.testing.assert_allclose(along[[0, -1]], 1.0, atol=1e-9)
    on_itself = [R for R in turns if (((whole @ R.T) @ whole.T).max(axis=1) > 1.0 - 1e-9).all()]
    assert len(on_itself) == 2 * order - 1
    apart = [angle_of(one @ other.T) for k, one in enumerate(turns) for other in turns[:k]]
    assert min(apart) > 0.1


@pytest.mark.parametrize("normals", [np.eye(3), np.eye(3)[:1], np.eye(3)[:2], sides(4, 4)])
def test_a_cube_is_no_prism(normals: FloatArray) -> None:
    assert prism_turns(normals @ ASKEW.T) == []


@pytest.mark.parametrize("shown", [1, 2, 3])
def test_turns_of_a_cube_are_its_twenty_three(shown: int) -> None:
    axes = ASKEW.T
    turns = _cube_turns(axes[:shown])
    assert len(turns) == 23
    for R in turns:
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert angle_of(R) > 1.0
        if shown > 1:
            mapped = axes @ R.T @ axes.T
            np.testing.assert_allclose(np.sort(np.abs(mapped), axis=1), [[0.0, 0.0, 1.0]] * 3, atol=1e-9)


def corner(part: Mesh, seed: int) -> FloatArray:
    """Points of the three faces that meet in a corner."""
    rng = np.random.default_rng(seed)
    sampled = sample_mesh(part, 3_000, rng)
    assert sampled.normals is not None
    shown = sampled.points[(sampled.normals > 0.5).any(axis=1)]
    return shown + NOISE * rng.normal(size=shown.shape)


@functools.cache
def fit(name: str) -> Fit:
    if name == "sheet":
        return fit_of(problem_of(bumpy_cloud(2_000, 1), bumpy_cloud(2_000, 2), np.eye(4), effort="fast"))
    part = CUBE if name.startswith("cube") else BLOCK
    target = part if name.endswith("on a part") else corner(part, 2)
    return fit_of(problem_of(corner(part, 1), target, np.eye(4), effort="fast"))


@functools.cache
def rivals(name: str) -> FloatArray:
    return corner_rivals(fit(name))


def test_ends_are_the_farthest_points_but_for_a_few() -> None:
    points = np.random.default_rng(0).normal(size=(5_000, 3))
    directions = np.vstack([np.eye(3), -np.eye(3)])
    found = _ends(points, directions)
    for direction, end in zip(directions, found, strict=True):
        assert 3 <= np.count_nonzero(points @ direction > end) <= 6


def test_turned_poses_lay_the_ends_of_both_on_each_other() -> None:
    # Both somewhere, so that the middle of the cube is not that of the rotations.
    normals, turns, middle = np.eye(3), _cube_turns(np.eye(3)), np.array([20.0, -30.0, 50.0])
    placed = fit("cube").at(pose.from_parts(np.eye(3), middle) @ fit("cube").T_target_source)
    poses = _turned(placed, fit("cube").target.geometry.points + middle, normals, turns)  # type: ignore[union-attr]
    assert poses.shape == (23, 4, 4)
    for R, T in zip(turns, poses, strict=True):
        np.testing.assert_allclose(T[:3, :3], R @ placed.T_target_source[:3, :3], atol=1e-12)
        # The whole cube is where it was, and so is its middle.
        after = T @ pose.inverse(placed.T_target_source)
        np.testing.assert_allclose(pose.apply(after, middle[None])[0], middle, atol=1.0)


def test_rivals_of_a_cube_put_its_corner_on_others() -> None:
    found = rivals("cube")
    assert len(found) >= 6
    for T in found:
        moved = pose.apply(fit("cube").problem.to_caller(T), CUBE.vertices)
        nearest = np.linalg.norm(moved[:, None] - CUBE.vertices, axis=2)
        assert nearest.min(axis=1).max() < 0.02 * CUBE.diagonal
        assert sorted(nearest.argmin(axis=1).tolist()) == list(range(len(CUBE.vertices)))
        # And it is another place: some corner goes elsewhere.
        assert nearest.diagonal().max() > 0.5 * 60.0


@pytest.mark.parametrize("name", ["block", "sheet", "cube on a part"])
def test_there_are_none_where_ends_tell_or_more_is_in_common(name: str) -> None:
    assert rivals(name).shape == (0, 4, 4)


def test_only_a_pose_that_no_start_meant_is_compared() -> None:
    near, far = np.eye(4), pose.from_parts(np.eye(3), [200.0, 0.0, 0.0])
    for name, start in (("cube", near), ("cube on a part", None), ("cube on a part", far)):
        known = BestPoses(fit(name), NO_POSES)
        assert beside_corners(known, start) is known
    known = BestPoses(fit("cube"), NO_POSES, turned=near[None])
    found = beside_corners(known, None)
    np.testing.assert_array_equal(found.turned, np.concatenate([near[None], rivals("cube")]))
    assert found.fit is known.fit
