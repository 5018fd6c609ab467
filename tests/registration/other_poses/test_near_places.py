"""Motions from a pose to others: of a plate that is nearly symmetric, of blocks that are, and amid a scene."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.near_places import is_same_place, near_maps, ring_maps, rows_beside
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.search.plane_maps import MAX_LOST_SHARE
from dqreg.synth.parts import box
from tests.registration.scenes import fit_of, problem_of

BLOCK = Mesh(*box((100.0, 60.0, 40.0)))
NOISE = 0.02


def plate(unit: float = 1.0) -> Mesh:
    """A square plate with four lugs, of which one is lower: a quarter of a turn leaves it nearly as it is."""
    vertices, faces, count = [], [], 0
    lugs = [((8.0, 8.0, 8.0), (x, y, 9.0)) for x, y in ((-32.0, -32.0), (32.0, -32.0), (32.0, 32.0))]
    for size, at in (((80.0, 80.0, 10.0), (0.0, 0.0, 0.0)), *lugs, ((8.0, 8.0, 6.0), (-32.0, 32.0, 8.0))):
        part = Mesh(*box(size))
        vertices.append(part.vertices - part.centre + at)
        faces.append(part.faces + count)
        count += len(part.vertices)
    return Mesh(unit * np.concatenate(vertices), np.concatenate(faces))


@functools.cache
def fit(name: str, unit: float = 1.0) -> Fit:
    part = plate(unit) if name == "plate" else BLOCK
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 2_500, rng).points
    points = points + unit * NOISE * rng.normal(size=points.shape)
    if name == "amid a scene":
        flat = rng.uniform(-400.0, 400.0, (4_000, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, BLOCK.bounds[0][2]]
        points = np.concatenate([points, flat])
    target = points[:, :] + 0.0 if name == "cloud" else part
    return fit_of(problem_of(points, target, np.eye(4), effort="fast"))


def half_turn(axis: int) -> FloatArray:
    return np.diag(np.where(np.arange(4) < 3, np.where(np.arange(4) == axis, 1.0, -1.0), 1.0))


QUARTER = pose.from_parts(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


@pytest.mark.parametrize("name", ["block", "cloud"])
def test_a_block_is_in_its_place_after_half_a_turn_and_not_after_a_quarter_or_a_shift(name: str) -> None:
    found = fit(name)
    # Between the centred frames, so that the axes of a cloud are a hair off the middle.
    for axis in range(3):
        assert is_same_place(found, half_turn(axis))
    assert is_same_place(found, np.eye(4))
    assert not is_same_place(found, QUARTER)
    assert not is_same_place(found, pose.from_parts(np.eye(3), [0.1 * BLOCK.diagonal, 0.0, 0.0]))


def test_what_a_symmetry_leads_to_is_no_other_place() -> None:
    assert near_maps(fit("block")).shape == (0, 4, 4)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_nearly_symmetric_part_is_turned_into_places_that_hold_most_of_it(unit: float) -> None:
    found = fit("plate", unit)
    maps, part = near_maps(found), plate(unit)
    centre = 0.5 * (part.bounds[0] + part.bounds[1])
    turns = np.rad2deg([angle_of(T[:3, :3]) for T in maps])
    # About its axis: a quarter of a turn either way, and half of one.
    about = np.abs(maps[:, 2, 2] - 1.0) < 1e-3
    np.testing.assert_allclose(np.sort(turns[about]), [90.0, 90.0, 180.0], atol=1.0)
    points, surface = sample_mesh(part, 1_000, np.random.default_rng(1)).points, MeshSurface(part)
    for T in maps:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        off = surface.closest(pose.apply(T, points - centre) + centre).distances
        assert np.mean(off < 0.01 * part.diagonal) > 1.0 - MAX_LOST_SHARE
        assert not is_same_place(found, T)


def test_rings_are_of_clouds() -> None:
    assert ring_maps(fit("plate")).shape == (0, 4, 4)
    # Of one that shows none there are no turns.
    assert ring_maps(fit("cloud")).shape == (0, 4, 4)


def test_all_points_tell_poses_apart_but_for_those_of_a_scene_that_no_pose_puts_into_the_part() -> None:
    found, here = fit("amid a scene"), np.eye(4)[None]
    scan = found.prepared.scan
    assert found.is_scene
    assert not fit("block").is_scene
    np.testing.assert_array_equal(rows_beside(fit("block"), here, 1.0), np.arange(len(fit("block").prepared.scan)))
    reach = 5.0
    part = found.problem.target.geometry
    assert isinstance(part, Mesh)
    aside = np.stack([np.eye(4), pose.from_parts(np.eye(3), [150.0, 0.0, 0.0])])
    for poses in (aside[:1], aside[1:], aside):
        rows = rows_beside(found, poses, reach)
        inside = [
            ((x >= part.bounds[0] - reach) & (x <= part.bounds[1] + reach)).all(axis=1)
            for x in (pose.apply(T, scan.points) for T in poses)
        ]
        np.testing.assert_array_equal(rows, np.flatnonzero(np.any(inside, axis=0)))
        assert 0 < len(rows) < len(scan)
    # Where no pose puts any there, all tell.
    nowhere = pose.from_parts(np.eye(3), [0.0, 0.0, 1e4])[None]
    assert len(rows_beside(found, nowhere, reach)) == len(scan)
