"""Faces of a part: which shape a tessellated face is of."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dqreg.geometry import Mesh
from dqreg.inspection import part_faces


def tube(radii: list[float], heights: list[float], around: int, step: float) -> Mesh:
    """A closed body of revolution with corners rounded to a step as coarse files have them, caps at its ends."""
    turns = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    rims = [np.column_stack([r * ring, np.full(around, z)]) for r, z in zip(radii, heights, strict=True)]
    corners = np.vstack([*rims, [[0.0, 0.0, heights[0]]], [[0.0, 0.0, heights[-1]]]])
    corners = step * np.round(corners / step)
    here, ahead = np.arange(around), (np.arange(around) + 1) % around
    faces = []
    for k in range(len(radii) - 1):
        a, b = k * around, (k + 1) * around
        faces += [np.column_stack([a + here, a + ahead, b + ahead]), np.column_stack([a + here, b + ahead, b + here])]
    low, high, last = len(corners) - 2, len(corners) - 1, (len(radii) - 1) * around
    faces += [np.column_stack([np.full(around, low), ahead, here])]
    faces += [np.column_stack([np.full(around, high), last + here, last + ahead])]
    return Mesh(corners, np.vstack(faces))


@pytest.mark.parametrize("size", [1.0, 25.4])
def test_rounded_corners_of_a_coarse_file_still_are_a_cylinder(size: float) -> None:
    # Rounded to 0.003 the corners lie 0.0021 off at most; the middles of the chords lie 0.0047 off.
    part = tube([3.4, 3.4], [0.0, 9.0], 60, 0.003)
    (wall,) = (face for face in part_faces(Mesh(size * part.vertices, part.faces)) if face.kind != "plane")
    assert wall.kind == "cylinder"
    assert wall.feature is not None
    assert wall.feature.diameter == pytest.approx(6.8 * size, abs=0.002 * size)
    assert wall.feature.form > 1e-4 * wall.extent


def test_a_barrel_is_no_cylinder_and_a_funnel_is_a_cone() -> None:
    # It bulges by twice of what its sides cut their chords: 3.4 (1 - cos 3 degrees) = 0.0047.
    barrel = tube([3.4, 3.405, 3.41, 3.405, 3.4], [0.0, 2.0, 4.0, 6.0, 8.0], 60, 1e-6)
    assert [face.kind for face in part_faces(barrel) if face.kind != "plane"] == ["free"]
    funnel = tube([3.4, 4.4], [0.0, 3.0], 60, 0.003)
    assert [face.kind for face in part_faces(funnel) if face.kind != "plane"] == ["cone"]


def bead(around: int = 40, across: int = 24) -> Mesh:
    """A closed ring of radii 12 and 2, wound outward."""
    u, v = (2.0 * np.pi * np.arange(n) / n for n in (around, across))
    u, v = np.repeat(u, across), np.tile(v, around)
    rho = 12.0 + 2.0 * np.cos(v)
    i, j = np.repeat(np.arange(around), across), np.tile(np.arange(across), around)
    at = lambda a, b: (a % around) * across + b % across  # noqa: E731
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    corners = np.column_stack([rho * np.cos(u), rho * np.sin(u), 2.0 * np.sin(v)])
    return Mesh(corners, np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


@pytest.mark.parametrize("size", [pytest.param(1.0, marks=pytest.mark.soak), 1e-3])
def test_a_ring_is_a_torus_of_its_radii_and_its_corners_in_single_precision_too(size: float) -> None:
    ring = bead()
    for corners, exact in ((size * ring.vertices, 1e-9), ((size * ring.vertices).astype(np.float32), 1e-6)):
        (face,) = part_faces(Mesh(corners.astype(np.float64), ring.faces))
        assert face.kind == "torus"
        assert face.feature is None
        assert face.torus is not None
        assert face.torus.major_radius == pytest.approx(12.0 * size, abs=14.0 * size * exact)
        assert face.torus.minor_radius == pytest.approx(2.0 * size, abs=14.0 * size * exact)


def test_a_fillet_with_few_facets_round_is_a_torus_and_no_coarse_cone() -> None:
    # The chords of 16 facets round a boss cut more than the fillet is bent.
    turns = np.linspace(np.pi, 1.5 * np.pi, 6)
    radii, heights = 21.0 + np.cos(turns), 1.0 + np.sin(turns)
    part = tube([20.0, *radii.tolist()], [3.0, *heights.tolist()], 16, 1e-9)
    rows = np.arange(len(part.faces)) // 32
    regions = np.where(rows == 0, 0, np.where(rows <= 5, 1, 2 + (np.arange(len(rows)) >= 6 * 32 + 16)))
    faces = part_faces(Mesh(part.vertices, part.faces[:, ::-1], regions=regions))
    assert [face.kind for face in faces] == ["cylinder", "torus", "plane", "plane"]
    fillet = faces[1].torus
    assert fillet is not None
    assert (fillet.major_radius, fillet.minor_radius) == pytest.approx((21.0, 1.0), abs=1e-7)
    assert fillet.centre == pytest.approx([0.0, 0.0, 1.0], abs=1e-7)


def test_a_cone_of_two_rims_is_no_cylinder_across_it() -> None:
    made = trimesh.creation.revolve(np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 10.0], [0.0, 10.0]]), sections=96)
    part = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    (wall,) = (face for face in part_faces(part) if face.kind != "plane")
    assert wall.kind == "cone"
    assert wall.feature is not None
    assert wall.feature.half_angle == pytest.approx(np.arctan(0.2), rel=1e-6)
    assert abs(wall.feature.axis[2]) == pytest.approx(1.0, abs=1e-9)
