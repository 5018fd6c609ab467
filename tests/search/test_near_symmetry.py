from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import smallest_kernel_scale
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis, angle_of
from dqreg.search.flipped_poses import (
    flipped_poses,
)
from dqreg.search.near_symmetry import is_symmetry, near_flips, near_mirrors
from dqreg.search.rings import Ring, ring_steps
from dqreg.search.scoring import distances_at
from dqreg.synth.parts import block, box, bracket, cylinder, flange, gear
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld

# Half a turn about an axis leaves this block in place but for one small feature.
BLOCK = Mesh(*block())
SURFACE = MeshSurface(BLOCK)
FLIPS = near_flips(BLOCK, SURFACE)
PART = Mesh(*bracket())
PART_SURFACE = MeshSurface(PART)
UP = np.array([0.0, 0.0, 1.0])


def test_a_nearly_symmetric_block_has_flips() -> None:
    assert 1 <= len(FLIPS) <= 23
    # They are proper motions, and none is the identity.
    for T in FLIPS:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0, abs=1e-12)
        assert pose.angle_between(T, np.eye(4)) > 1.0


@pytest.mark.parametrize("part", [box((3.0, 2.0, 1.0)), bracket()], ids=["symmetric", "plain"])
def test_a_symmetry_is_no_flip_and_neither_is_what_moves_the_part(part: tuple) -> None:
    mesh = Mesh(*part)
    assert len(near_flips(mesh, MeshSurface(mesh))) == 0


def test_a_nearly_cubic_block_has_the_flips_of_its_faces() -> None:
    # Its moments are so nearly equal that the notch decides where the principal axes are.
    levels = np.array([0.0, 0.75, 1.0])
    filled = np.ones((2, 2, 2), dtype=bool)
    filled[1, 1, 1] = False
    mesh = Mesh(*weld(cells([levels, 1.02 * levels, 0.98 * levels], filled)))
    flips = near_flips(mesh, MeshSurface(mesh))
    for signs in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        assert min(angle_of(T[:3, :3] @ np.diag(signs).astype(float)) for T in flips) < np.deg2rad(1.0)


def test_a_near_mirror_has_determinant_minus_one_and_moves_little():
    (mirror,) = near_mirrors(PART, PART_SURFACE)
    assert np.linalg.det(mirror[:3, :3]) == pytest.approx(-1.0, abs=1e-12)
    sample = sample_mesh(PART, 4_000, np.random.default_rng(0)).points
    off = PART_SURFACE.closest(pose.apply(mirror, sample)).distances
    assert 0.7 < np.mean(off < 5e-3 * PART.diagonal) < 0.998


def test_a_plate_with_a_boss_has_the_mirror_of_the_plate() -> None:
    # The boss draws the centre off the middle of the plate, by more than a near symmetry may leave.
    x, y, z = np.array([0.0, 7.0, 8.5, 10.0]), np.array([0.0, 4.0, 5.0, 6.0]), np.array([0.0, 1.0, 2.2])
    filled = np.zeros((3, 3, 2), dtype=bool)
    filled[:, :, 0] = True
    filled[1, 1, 1] = True
    mesh = Mesh(*weld(cells([x, y, z], filled)))
    mirrors = near_mirrors(mesh, MeshSurface(mesh))
    upside_down = np.diag([1.0, 1.0, -1.0, 1.0])
    upside_down[2, 3] = 1.0
    assert min(np.abs(T - upside_down).max() for T in mirrors) < 0.05


@pytest.mark.parametrize("angle_deg", [20.0, 35.0])
def test_a_near_mirror_may_lie_in_any_plane(angle_deg: float) -> None:
    # Two equal arms, one on either side of the plane; the block aside turns the principal axes by a degree and more.
    half = np.deg2rad(angle_deg)
    arm = box((8.0, 1.0, 0.8))
    arm = arm[0] + np.array([2.0, -0.5, -0.4]) - arm[0].min(axis=0), arm[1]
    corners, faces = box((1.4, 1.4, 1.4))
    corners = corners - corners.min(axis=0) + np.array([4.0, 0.2, 1.0])
    arms = [arm[0] @ about_axis(UP, angle).T for angle in (half, -half)]
    count = len(arm[0])
    mesh = Mesh(np.concatenate([*arms, corners]), np.concatenate([arm[1], arm[1] + count, faces + 2 * count]))
    mirrors = near_mirrors(mesh, MeshSurface(mesh))
    assert min(np.abs(T - np.diag([1.0, -1.0, 1.0, 1.0])).max() for T in mirrors) < 0.05


@pytest.mark.parametrize("shape", [box((3.0, 2.0, 1.0)), box((2.0, 2.0, 2.0))])
def test_what_is_its_own_mirror_image_has_no_twin(shape):
    mesh = Mesh(*shape)
    assert len(near_mirrors(mesh, MeshSurface(mesh))) == 0


def wheel(teeth: int) -> Mesh:
    return Mesh(*gear(teeth=teeth))


def marked(teeth: int) -> Mesh:
    """A gear of which one tooth is worn by a tenth of the radius: no turn leaves it as it is."""
    part = wheel(teeth)
    vertices = part.vertices.copy()
    angle, radius = np.arctan2(vertices[:, 1], vertices[:, 0]), np.hypot(vertices[:, 0], vertices[:, 1])
    worn = (np.abs(angle) < np.pi / teeth) & (radius > 0.9 * radius.max())
    vertices[worn, :2] *= 0.9
    return Mesh(vertices, part.faces)


@pytest.mark.parametrize("teeth", [14, 18, 24, 31])
def test_the_step_of_a_gear_is_one_tooth(teeth: int) -> None:
    part = wheel(teeth)
    steps = ring_steps(Ring.of(part, MeshSurface(part)))
    angles = np.array([angle_of(R) for R in steps])
    assert np.abs(angles - 2.0 * np.pi / teeth).min() <= 1e-9
    # Either way, and nothing but whole teeth.
    np.testing.assert_allclose(angles[::2], angles[1::2], atol=1e-9)
    np.testing.assert_allclose(angles * teeth / (2.0 * np.pi), np.rint(angles * teeth / (2.0 * np.pi)), atol=1e-6)


def spoilt(part: tuple, diameter: float) -> Mesh:
    """The part with a cube inside it, near its rim."""
    vertices, faces = part
    cube, sides = box((0.06 * diameter,) * 3)
    inside = cube - cube.mean(axis=0) + [0.2 * diameter, 0.1 * diameter, 0.3 * np.ptp(vertices[:, 2])]
    return Mesh(np.concatenate([vertices, inside]), np.concatenate([faces, sides + len(vertices)]))


def test_the_step_of_a_few_bolts_is_found_beside_what_breaks_their_ring() -> None:
    """Bolts are some hundredths of the surface, and a cube out of place nearly as much."""
    mesh = spoilt(flange(diameter=120.0, bolts=5), 120.0)
    steps = ring_steps(Ring.of(mesh, MeshSurface(mesh)))
    assert np.abs(np.array([angle_of(R) for R in steps]) - np.deg2rad(72.0)).min() <= 1e-9


def test_a_disc_that_one_thing_breaks_has_no_step() -> None:
    mesh = spoilt(cylinder(diameter=120.0, height=20.0, segments=96), 120.0)
    assert ring_steps(Ring.of(mesh, MeshSurface(mesh))) == []


@pytest.mark.parametrize("part", [bracket(), block()], ids=["plain", "block"])
def test_what_has_no_teeth_has_no_step(part: tuple) -> None:
    mesh = Mesh(*part)
    assert ring_steps(Ring.of(mesh, MeshSurface(mesh))) == []


def test_turns_of_a_cylinder_by_its_facets_are_symmetries_and_tell_nothing() -> None:
    mesh = Mesh(*cylinder())
    surface = MeshSurface(mesh)
    turns = near_flips(mesh, surface)
    assert len(turns)
    assert all(is_symmetry(T, mesh, surface) for T in turns)


def star(points: int) -> Mesh:
    """A prism over a star with one point worn off, turned by 10 degrees."""
    angles = np.deg2rad(10.0) + np.arange(2 * points) * np.pi / points
    radii = np.where(np.arange(2 * points) % 2, 6.0, 10.0)
    radii[0] = 9.0
    rim = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    low, high = (np.column_stack([np.append(rim, [[0.0, 0.0]], axis=0), np.full(2 * points + 1, z)]) for z in (0, 3))
    here = np.arange(2 * points)
    there, hub, up = (here + 1) % (2 * points), np.full(2 * points, 2 * points), 2 * points + 1
    faces = [
        [there, here, hub],
        [here + up, there + up, hub + up],
        [here, there, there + up],
        [here, there + up, here + up],
    ]
    return Mesh(np.concatenate([low, high]), np.concatenate([np.stack(rows, axis=1) for rows in faces]))


def test_a_ring_is_flipped_about_axes_across_it() -> None:
    # Half a turn about an axis through a point of the star, or between two: its moments name neither.
    part = star(7)
    across = [T[:3, :3] for T in near_flips(part, MeshSurface(part)) if T[2, 2] < -0.99]
    axes = np.array([np.arctan2(R[1, 0], R[0, 0]) / 2.0 for R in across])
    # The lines of symmetry of seven points are 180 / 7 degrees apart.
    off = ((axes - np.deg2rad(10.0)) * 7.0 / np.pi + 0.5) % 1.0 - 0.5
    assert len(across) >= 2
    assert np.abs(off).max() < 0.05


def test_a_pose_that_is_one_tooth_off_is_told() -> None:
    part = marked(18)
    surface = MeshSurface(part)
    noise = 2e-4 * part.diagonal
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 20_000, rng).points
    # The scan is made in the part's frame: the truth is the identity, and this is one tooth away from it.
    scan = prepare_scan(PointCloud(points + noise * rng.normal(size=points.shape)), 2_000)
    wrong = pose.from_parts(about_axis(UP, 2.0 * np.pi / 18), np.zeros(3))
    flips, limit, floor = near_flips(part, surface), 0.05 * part.diagonal, smallest_kernel_scale(scan, surface)
    found = flipped_poses(wrong, flips, scan, surface, limit, floor)
    assert min(pose.angle_between(T, np.eye(4)) for T, _ in found) <= 2e-3
    # And from the truth none of the others is as good.
    assert flipped_poses(np.eye(4), flips, scan, surface, limit, floor) == []


def maps_onto(maps: np.ndarray, R: np.ndarray, mesh: Mesh) -> float:
    """Largest share of a part that one of some motions with a rotation leaves in place to a hundredth of its size."""
    points = sample_mesh(mesh, 2_000, np.random.default_rng(5)).points
    alike = [T for T in maps if angle_of(T[:3, :3] @ R.T) < np.deg2rad(3.0)]
    surface = MeshSurface(mesh)
    away = [surface.closest(pose.apply(T, points)).distances for T in alike]
    return max((float(np.mean(each < 5e-3 * mesh.diagonal)) for each in away), default=0.0)


def test_a_plate_with_a_block_on_one_side_has_its_half_turns() -> None:
    # The block moves the centre of the surface by 3 % of the size, and a half-turn about that moves all of the plate.
    x, y, z = np.array([0.0, 80.0, 100.0]), np.array([0.0, 40.0, 60.0]), np.array([0.0, 5.0, 25.0])
    filled = np.ones((2, 2, 2), dtype=bool)
    filled[:, :, 1] = [[False, False], [False, True]]
    mesh = Mesh(*weld(cells([x, y, z], filled)))
    assert np.linalg.norm(mesh._moments[0][:2] - [50.0, 30.0]) > 0.03 * mesh.diagonal
    flips = near_flips(mesh, MeshSurface(mesh))
    for signs in ([1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]):
        assert maps_onto(flips, np.diag(signs), mesh) > 0.75


def test_a_sheet_with_unequal_legs_to_either_side_has_the_half_turn_about_its_web() -> None:
    # A Z whose legs are 30 and 60 long: its planes come to lie in each other, its ends do not.
    x, z = np.array([0.0, 2.0, 32.0, 60.0, 62.0, 120.0]), np.array([0.0, 2.0, 60.0, 62.0])
    filled = np.zeros((5, 1, 3), dtype=bool)
    filled[2:4, :, 0] = True
    filled[3, :, :] = True
    filled[3:, :, 2] = True
    mesh = Mesh(*weld(cells([x, np.array([0.0, 80.0]), z], filled)))
    flips = near_flips(mesh, MeshSurface(mesh))
    assert maps_onto(flips, np.diag([-1.0, 1.0, -1.0]), mesh) > 0.75


def test_the_part_as_it_is_is_not_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def seen(poses, *given, **how):
        asked.extend(angle_of(R) for R in poses.R)
        return distances_at(poses, *given, **how)

    monkeypatch.setattr("dqreg.search.near_symmetry.distances_at", seen)
    near_flips(PART, PART_SURFACE)
    assert min(asked) > np.deg2rad(5.0)
