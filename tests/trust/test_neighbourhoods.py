"""Neighbourhoods of a scan against those of their closest points, on shapes whose closest points are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes_among
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis
from dqreg.synth.parts import bracket
from dqreg.trust.neighbourhoods import Neighbourhoods, apart_in_cells, is_flat

PART = Mesh(*bracket())
SURFACE = MeshSurface(PART)


def said(points: np.ndarray, within: float, width: float = 0.0) -> Neighbourhoods:
    found = SURFACE.closest(points)
    return Neighbourhoods.of(points, found.points, found.normals, found.distances <= within, width)


def asked(points: np.ndarray, within: float) -> float:
    return said(points, within).apart


@pytest.mark.parametrize("count", [60, 1_000, 3_000])
def test_neighbourhoods_over_edges_agree_at_the_right_pose(count: int) -> None:
    # The scan is made in the part's frame: the truth is the identity. With few points every neighbourhood spans edges.
    rng = np.random.default_rng(count)
    noise = 3e-4 * PART.diagonal
    points = sample_mesh(PART, count, rng).points + noise * rng.normal(size=(count, 3))
    assert asked(points, 4.0 * noise) < 0.01


def test_where_faces_cross_they_disagree() -> None:
    # Dense faces that cross those of the part at an angle of 50 degrees; only points near the line are within reach.
    rng = np.random.default_rng(0)
    turn = pose.about(
        pose.from_parts(about_axis(np.array([0.0, 1.0, 0.0]), np.deg2rad(50.0)), np.zeros(3)), PART.centre
    )
    points = pose.apply(turn, sample_mesh(PART, 20_000, rng).points)
    assert asked(points, 0.01 * PART.diagonal) > 0.5


def test_a_single_profile_has_no_normals() -> None:
    points = sample_mesh(PART, 40_000, np.random.default_rng(0)).points
    profile = points[np.abs(points[:, 1] - PART.centre[1]) < 1e-3 * PART.diagonal]
    assert is_flat(profile)
    assert math.isnan(asked(profile, 1e-3 * PART.diagonal))
    assert not is_flat(points[:500])


def test_points_of_one_profile_say_nothing_of_faces_and_noise() -> None:
    # Laser fans 5 mm apart with noise within the fan. Planes fitted to the neighbours of a point are those of the fans:
    # they cross the face, and leave no noise.
    rng = np.random.default_rng(0)
    noise = 1.0
    x, y = np.meshgrid(np.arange(0.0, 60.0, 5.0), np.arange(0.0, 60.0, 0.5))
    points = np.column_stack([x.ravel(), y.ravel() + noise * rng.normal(size=x.size), noise * rng.normal(size=x.size)])
    feet = points * [1.0, 1.0, 0.0]
    # A wall at the end, or it would be one face only.
    wall = np.column_stack([np.zeros(200), rng.uniform(0.0, 60.0, 200), rng.uniform(0.0, 30.0, 200)]) - [5.0, 0.0, 0.0]
    up = np.concatenate([np.tile([0.0, 0.0, 1.0], (x.size, 1)), np.tile([1.0, 0.0, 0.0], (200, 1))])
    points, feet = (
        np.concatenate([points, wall + noise * rng.normal(size=(200, 1)) * [1.0, 0.0, 0.0]]),
        np.concatenate([feet, wall]),
    )
    found = Neighbourhoods.of(points, feet, up, np.ones(len(points), dtype=bool), noise)
    own = fit_planes_among(points, NeighbourTree(points).nearest(points, 16)[0])
    assert float(np.median(own.residuals[: x.size])) < 0.01 * noise
    assert np.mean(np.abs(own.normals[: x.size, 2]) < 0.8) > 0.5
    assert not found.apart > 0.05
    assert not found.noise < 0.5 * noise


def terraces(seed: int, step: float) -> np.ndarray:
    """A depth image of the part's faces towards one corner, rounded to terraces along the view."""
    view = np.array([1.0, 0.5, 0.7]) / np.linalg.norm([1.0, 0.5, 0.7])
    sampled = sample_mesh(PART, 60_000, np.random.default_rng(seed))
    points = sampled.points[sampled.normals @ view > 0.2]
    depths = points @ view
    return points + ((np.round(depths / step) * step - depths)[:, None]) * view


def test_terraces_of_two_depth_images_agree_in_cells_and_hardly_in_neighbourhoods() -> None:
    # Both images are made in the part's frame: the truth is the identity. A face that is turned by 50 degrees about
    # the middle of the part crosses the other image's faces, and is within reach beside the lines where it does.
    step = 0.01 * PART.diagonal
    one, other = terraces(0, step), terraces(1, step)
    own = fit_planes_among(one, NeighbourTree(one).nearest(one[::40], 16)[0])
    there = fit_planes_among(other, NeighbourTree(other).nearest(one[::40], 16)[0])
    cosines = np.abs(np.einsum("ij,ij->i", own.normals, there.normals))
    assert np.mean(cosines < np.cos(np.deg2rad(35.0))) > 0.15
    assert apart_in_cells(one, other, np.eye(4), 2.0 * step) < 0.1
    turned = pose.from_parts(about_axis(np.array([0.0, 1.0, 0.0]), np.deg2rad(50.0)), np.zeros(3))
    assert apart_in_cells(one, other, pose.about(turned, PART.centre), 2.0 * step) > 0.3


def test_cells_that_hold_few_points_or_no_plane_say_nothing() -> None:
    rng = np.random.default_rng(2)
    faces = [sample_mesh(PART, 20_000, rng).points for _ in range(2)]
    assert math.isnan(apart_in_cells(*faces, np.eye(4), 0.1 * PART.diagonal / np.sqrt(20_000)))
    clouds = rng.uniform(size=(2, 20_000, 3))
    assert math.isnan(apart_in_cells(*clouds, np.eye(4), 0.1))
