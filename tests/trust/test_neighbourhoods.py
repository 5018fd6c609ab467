"""Neighbourhoods of a scan against those of their closest points, on shapes whose closest points are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis
from dqreg.synth.parts import bracket
from dqreg.trust.neighbourhoods import is_flat, share_apart

PART = Mesh(*bracket())
SURFACE = MeshSurface(PART)


def asked(points: np.ndarray, within: float) -> float:
    found = SURFACE.closest(points)
    return share_apart(points, found.points, found.normals, found.distances <= within)


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
