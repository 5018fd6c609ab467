from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.rigid.symmetry import Symmetry
from dqreg.search.features import even_points
from dqreg.search.grids import PlaneGrid
from dqreg.search.symmetry import ON_PART_DIAGONALS, find_symmetry, symmetry_words
from dqreg.synth.parts import box, cylinder


def symmetry_of(mesh: Mesh) -> Symmetry:
    surface = MeshSurface(mesh)
    grid = PlaneGrid(surface, even_points(mesh, surface, 20_000), *mesh.bounds)
    return find_symmetry(mesh, surface, grid)


def prism(corners: np.ndarray, height: float) -> Mesh:
    """A prism over a polygon that is star-shaped about the origin, both ends closed."""
    n = len(corners)
    low, high = (np.column_stack([corners, np.full(n, z)]) for z in (0.0, height))
    vertices = np.concatenate([low, high, [[0, 0, 0.0], [0, 0, height]]])
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    ends = np.concatenate(
        [np.column_stack([j, i, np.full(n, 2 * n)]), np.column_stack([i + n, j + n, np.full(n, 2 * n + 1)])]
    )
    return Mesh(vertices, np.concatenate([sides, ends]))


def pinwheel(arms: int) -> Mesh:
    """Teeth that lean one way: turns leave it as it is, mirrors do not."""
    angles = 2.0 * np.pi * np.arange(3 * arms) / (3 * arms)
    radii = np.tile([1.0, 2.0, 1.3], arms)
    return prism(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]), 0.7)


@pytest.mark.parametrize(
    ("sides", "orders"),
    [
        ((3.0, 2.0, 1.0), [2, 2, 2]),
        ((2.0, 2.0, 1.0), [4, 2, 2, 2, 2]),
        ((1.0, 1.0, 1.0), [4] * 3 + [3] * 4 + [2] * 6),
    ],
    ids=["box", "square box", "cube"],
)
def test_boxes_have_the_groups_of_the_textbook(sides, orders):
    found = symmetry_of(Mesh(*box(sides)))
    assert [axis.order for axis in found.axes] == orders
    # A turn group of an axis of order n has n - 1 turns besides the identity.
    assert len(found.poses) - 1 == sum(order - 1 for order in orders)


@pytest.mark.parametrize("arms", [3, 5])
def test_turns_without_mirrors_across(arms):
    part = pinwheel(arms)
    found = symmetry_of(part)
    assert max(axis.order for axis in found.axes) == arms
    main = found.axes[0]
    np.testing.assert_allclose(np.abs(main.direction), [0, 0, 1], atol=1e-3)
    assert f"{360.0 / arms:.4g} degrees" in symmetry_words(main)
    surface = MeshSurface(part)
    for T in found.poses:
        assert surface.closest(pose.apply(T, part.vertices)).distances.max() < ON_PART_DIAGONALS * part.diagonal


def test_a_cylinder_is_round_and_may_be_turned_over():
    found = symmetry_of(Mesh(*cylinder()))
    assert found.axes[0].order is None
    assert "any rotation" in symmetry_words(found.axes[0])
    assert [axis.order for axis in found.axes[1:]] == [2]
    assert len(found.poses) == 2


def test_a_mirror_symmetric_part_has_no_second_pose():
    part = prism(np.array([[2.0, 0.0], [0.5, 1.0], [-1.0, 0.7], [-1.0, -0.7], [0.5, -1.0]]), 1.0)
    # A lid that is smaller takes the mirror between both ends away.
    vertices = part.vertices.copy()
    vertices[vertices[:, 2] > 0.5, :2] *= 0.5
    found = symmetry_of(Mesh(vertices, part.faces))
    assert found.axes == ()
    assert found.poses.tolist() == [np.eye(4).tolist()]


def test_one_small_feature_breaks_the_symmetry():
    mesh = Mesh(*box((3.0, 2.0, 1.0), divisions=8))
    vertices = mesh.vertices.copy()
    corner = (vertices == [1.5, 1.0, 0.5]).all(axis=1)
    assert corner.any()
    vertices[corner] -= 0.1
    found = symmetry_of(Mesh(vertices, mesh.faces))
    assert found.poses.shape == (1, 4, 4)
    # The search still has to know the turns that it must tell apart.
    assert len(found.near) >= 3


def test_the_axis_between_two_poses_is_found():
    found = symmetry_of(Mesh(*box((3.0, 2.0, 1.0))))
    T = pose.random(np.random.default_rng(0), reach=2.0)
    axis = found.between(T, found.poses[1] @ T, 0.01)
    assert axis.order == 2
    assert "180 degrees" in symmetry_words(axis)
    assert found.between(T, pose.exp([0.5, 0, 0, 0, 0, 0]) @ T, 0.01) is None


def test_a_shift_is_no_symmetry():
    # A period of a lattice, with or without a half-turn, puts the part somewhere else.
    found = symmetry_of(Mesh(*box((3.0, 2.0, 1.0))))
    T, shift = np.eye(4), pose.exp([0, 0, 0, 0.4, 0, 0])
    assert found.between(T, shift @ T, 0.01) is None
    assert found.between(T, shift @ found.poses[1] @ T, 0.01) is None


def test_with_a_near_symmetry_of_a_ring_goes_its_inverse() -> None:
    # 31 teeth, two of which differ: more steps nearly fit than are kept.
    angles, radii = 2.0 * np.pi * np.arange(93) / 93, np.tile([1.0, 1.25, 1.1], 31)
    radii[[1, 4]] = 1.0, 1.1
    near = symmetry_of(prism(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]), 0.3)).near
    assert len(near) > 10
    assert all(min(angle_of(T[:3, :3] @ other[:3, :3]) for other in near) < 0.02 for T in near)
