"""Planes of a scan in other planes of its target: corners of a block."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose
from dqreg.search.plane_maps import SAME_PLANE_DIAGONALS, Planes, plane_maps
from dqreg.synth.parts import box, cylinder

BLOCK = Mesh(*box((90.0, 60.0, 40.0)))


def planes_of(mesh: Mesh, seed: int, near: np.ndarray | None = None, reach: float = np.inf) -> Planes:
    """Planes of a mesh, or of the piece about a place, in the size of the whole; either sign of the normals."""
    rng = np.random.default_rng(seed)
    sample = sample_mesh(mesh, 20_000, rng)
    kept = np.linalg.norm(sample.points - (0.0 if near is None else near), axis=1) < reach
    normals = np.asarray(sample.normals)[kept] * rng.choice([-1.0, 1.0], (kept.sum(), 1))
    return Planes.of(sample.points[kept], normals, mesh.diagonal)


def test_a_corner_fits_all_corners_of_a_block_three_ways_round() -> None:
    corners = BLOCK.vertices
    scan, size = planes_of(BLOCK, 0, corners.max(axis=0), 30.0), BLOCK.diagonal
    maps = plane_maps(scan, planes_of(BLOCK, 1), size)
    placed = np.array([pose.apply(T, corners.max(axis=0)[None])[0] for T in maps])
    away = np.linalg.norm(placed[:, None] - corners, axis=2)
    assert len(maps) == 23
    assert away.min(axis=1).max() <= 3.0 * SAME_PLANE_DIAGONALS * size
    # Three at each corner, and two beside the identity at its own.
    assert sorted(np.bincount(away.argmin(axis=1), minlength=8).tolist()) == [2, *[3] * 7]
    assert np.linalg.det(maps[:, :3, :3]) == pytest.approx(np.ones(23))


def test_a_whole_block_fits_its_half_turns_and_a_round_part_nothing() -> None:
    assert len(plane_maps(planes_of(BLOCK, 0), planes_of(BLOCK, 1), BLOCK.diagonal)) == 3
    shaft = Mesh(*cylinder(diameter=30.0, height=80.0))
    assert len(plane_maps(planes_of(shaft, 0), planes_of(shaft, 1), shaft.diagonal)) == 0


def test_what_two_directions_leave_open_the_ends_close() -> None:
    # Two faces along an edge, all of it, and none of the ends: that edge the other way round, and the three others.
    mesh = Mesh(*box((90.0, 40.0, 40.0)))
    points = sample_mesh(mesh, 20_000, np.random.default_rng(2)).points
    high = mesh.bounds[1]
    on = (points[:, 1:] > 0.0).all(axis=1) & (np.abs(points[:, 0]) < high[0] - 1e-9)
    points = points[on & (np.abs(points[:, 1:] - high[1:]) < 1e-9).any(axis=1)]
    normals = np.where(np.abs(points - high) < 1e-9, [0.0, 1.0, 1.0], 0.0)
    scan, part = Planes.of(points, normals, mesh.diagonal), planes_of(mesh, 1)
    assert not len(plane_maps(scan, part, mesh.diagonal))
    maps = plane_maps(scan, part, mesh.diagonal, reaching=points)
    middle = points.mean(axis=0)
    placed = np.array([pose.apply(T, middle[None])[0] for T in maps])
    assert np.abs(np.abs(placed) - np.abs(middle)).max() <= 2.0 * SAME_PLANE_DIAGONALS * mesh.diagonal
    assert {tuple(row) for row in np.sign(placed[:, 1:]).tolist()} == {(1, 1), (1, -1), (-1, 1), (-1, -1)}


def test_a_single_plane_is_laid_along_its_target_and_its_ends_close_what_that_leaves() -> None:
    # Of the top of a block as much as is about its middle: turned over it lies at the bottom.
    target = sample_mesh(BLOCK, 4_000, np.random.default_rng(0))
    on_top = (target.normals[:, 2] > 0.9) & (np.abs(target.points - BLOCK.centre) < [40.0, 25.0, 90.0]).all(axis=1)
    planes = Planes.of(target.points, target.normals, BLOCK.diagonal)
    top = Planes.of(target.points[on_top], target.normals[on_top], BLOCK.diagonal)
    assert not len(plane_maps(top, planes, BLOCK.diagonal, reaching=top.points))
    maps = plane_maps(top.beside(planes), planes, BLOCK.diagonal, reaching=top.points)
    turned = pose.about(np.diag([1.0, -1.0, -1.0, 1.0]), BLOCK.centre)
    away = [np.abs(pose.apply(T, top.points) - pose.apply(turned, top.points)).max() for T in maps]
    assert min(away) < 0.02 * BLOCK.diagonal
