"""Smooth faces are cut where their curvature changes, and nowhere else."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from dqreg.geometry import Mesh
from dqreg.inspection import part_faces


def turned(radius: np.ndarray, height: np.ndarray, steps: int = 48) -> Mesh:
    """A surface of revolution through a profile, closed at both ends by a point on its axis."""
    turns = np.linspace(0.0, 2.0 * np.pi, steps, endpoint=False)
    rings = np.stack(
        [np.outer(radius, np.cos(turns)), np.outer(radius, np.sin(turns)), np.repeat(height[:, None], steps, axis=1)],
        axis=2,
    )
    index = np.arange(len(radius) * steps).reshape(len(radius), steps)
    a, b, c, d = index[:-1], np.roll(index, -1, 1)[:-1], np.roll(index, -1, 1)[1:], index[1:]
    faces = [np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([a, c, d], axis=2).reshape(-1, 3)]
    low, high = index.size, index.size + 1
    faces += [np.stack([np.full(steps, low), np.roll(index[0], -1), index[0]], axis=1)]
    faces += [np.stack([np.full(steps, high), index[-1], np.roll(index[-1], -1)], axis=1)]
    ends = np.array([[0.0, 0.0, height[0]], [0.0, 0.0, height[-1]]])
    return Mesh(np.vstack([rings.reshape(-1, 3), ends]), np.concatenate(faces))


def extruded(outline: np.ndarray, height: float) -> Mesh:
    """A convex outline along z, its ends closed by fans."""
    count = len(outline)
    vertices = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (0.0, height)])
    here, there = np.arange(count), np.roll(np.arange(count), -1)
    sides = [np.stack([here, there, there + count], axis=1), np.stack([here, there + count, here + count], axis=1)]
    fan = np.stack([np.zeros(count - 2, dtype=int), here[1:-1], here[2:]], axis=1)
    return Mesh(vertices, np.concatenate([*sides, fan[:, ::-1], fan + count]))


def rounded_square(half: float, radius: float, steps: int = 8) -> np.ndarray:
    turns = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    corners = [
        np.stack([np.cos(turns + t), np.sin(turns + t)], axis=1) * radius
        + (half - radius) * np.sqrt(2.0) * np.array([np.cos(t + np.pi / 4), np.sin(t + np.pi / 4)])
        for t in np.arange(4) * np.pi / 2
    ]
    return np.concatenate(corners)


def test_a_boss_and_its_fillet_are_a_cylinder_and_a_torus() -> None:
    # A plate of 60, a fillet of 3 round a boss of 16, and its flat end.
    angles = np.linspace(-0.5 * np.pi, -np.pi, 8)
    radius = np.r_[30.0, 30.0, 11.0 + 3.0 * np.cos(angles), 8.0]
    height = np.r_[0.0, 5.0, 8.0 + 3.0 * np.sin(angles), 20.0]
    faces = part_faces(turned(radius, height))
    assert Counter(face.kind for face in faces) == {"plane": 3, "cylinder": 2, "torus": 1}
    (fillet,) = (face.torus for face in faces if face.torus is not None)
    assert (fillet.major_radius, fillet.minor_radius) == pytest.approx((11.0, 3.0), rel=1e-9)


@pytest.mark.parametrize("radius", [1.0, 6.0])
def test_a_wall_with_rounded_corners_is_planes_and_cylinders(radius: float) -> None:
    faces = part_faces(extruded(rounded_square(10.0, radius), 4.0))
    assert Counter(face.kind for face in faces) == {"plane": 6, "cylinder": 4}
    found = [face.feature.radius for face in faces if face.kind == "cylinder" and face.feature]
    assert found == pytest.approx([radius] * 4, rel=1e-9)


def test_a_whole_cylinder_a_ball_and_a_free_wall_stay_whole() -> None:
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    assert Counter(face.kind for face in part_faces(extruded(circle, 1.0))) == {"plane": 2, "cylinder": 1}
    # Written with three digits its corners are off by a third of what its sides cut off.
    assert len(part_faces(extruded(circle.round(3), 1.0))) == 3
    assert len(part_faces(extruded(circle * [2.0, 1.0], 1.0))) == 3
    rows = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 16)[1:-1]
    ball = part_faces(turned(np.cos(rows), np.sin(rows)))
    # The row round its middle is as straight as a wall.
    assert len(ball) == 1
