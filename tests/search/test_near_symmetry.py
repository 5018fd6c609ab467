from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import smallest_kernel_scale
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis, angle_of
from dqreg.search.near_symmetry import (
    FIRST,
    _not_clearly_worse,
    _refined,
    flipped_poses,
    gain_of_mirror,
    is_symmetry,
    near_flips,
    near_mirrors,
    ring_steps,
)
from dqreg.synth.parts import block, box, bracket, cylinder, flange, gear
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld
from dqreg.trust.limits import MIRRORED

# Half a turn about an axis leaves this block in place but for one small feature.
BLOCK = Mesh(*block())
SURFACE = MeshSurface(BLOCK)
FLIPS = near_flips(BLOCK, SURFACE)
NOISE = 2e-4 * BLOCK.diagonal
PART = Mesh(*bracket())
PART_SURFACE = MeshSurface(PART)
TWIN = Mesh(PART.vertices * [-1.0, 1.0, 1.0], PART.faces[:, ::-1])
UP = np.array([0.0, 0.0, 1.0])


def scan_of(points: np.ndarray):
    rng = np.random.default_rng(0)
    return prepare_scan(PointCloud(points + NOISE * rng.normal(size=points.shape)), 2_000)


def others(T: np.ndarray, scan) -> list:
    return flipped_poses(T, FLIPS, scan, SURFACE, 0.05 * BLOCK.diagonal, smallest_kernel_scale(scan, SURFACE))


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


def test_the_small_feature_decides_for_the_truth() -> None:
    # The scan is made in the part's frame: the truth is the identity.
    scan = scan_of(sample_mesh(BLOCK, 30_000, np.random.default_rng(1)).points)
    assert others(np.eye(4), scan) == []


def test_from_a_flip_the_truth_is_found_as_the_better_one() -> None:
    scan = scan_of(sample_mesh(BLOCK, 30_000, np.random.default_rng(1)).points)
    wrong = FLIPS[0]
    found = others(wrong, scan)
    assert found
    # To the noise of a thousand points that refine it.
    assert min(pose.offset_between(T, np.eye(4), at=BLOCK.centre) for T, _ in found) <= 1e-3 * BLOCK.diagonal
    assert min(pose.angle_between(T, np.eye(4)) for T, _ in found) <= 2e-3


def test_a_scan_that_does_not_see_the_feature_leaves_both_poses() -> None:
    points = sample_mesh(BLOCK, 60_000, np.random.default_rng(1)).points
    # What lies on the part in either pose cannot tell them apart.
    same = SURFACE.closest(pose.apply(FLIPS[0], points)).distances <= 1e-6 * BLOCK.diagonal
    found = others(np.eye(4), scan_of(points[same]))
    assert found
    assert min(pose.angle_between(T, FLIPS[0]) for T, _ in found) <= 1e-2


def test_few_points_drop_no_flip_that_is_equally_likely() -> None:
    # What lies on the part in either pose, with other noise each time. Of 200 seeds none came nearer to being dropped
    # than one standard error beyond what is allowed; the limit is 2.5.
    points = sample_mesh(BLOCK, 8_000, np.random.default_rng(1)).points
    points = points[SURFACE.closest(pose.apply(FLIPS[0], points)).distances <= 1e-6 * BLOCK.diagonal]
    for seed in range(16):
        noisy = points + NOISE * np.random.default_rng(seed).normal(size=points.shape)
        scan = prepare_scan(PointCloud(noisy), 100)
        lengths = 0.05 * BLOCK.diagonal, 0.3 * NOISE
        scores = _refined(np.eye(4), FLIPS[:1], scan, SURFACE, *lengths, FIRST)[1]
        assert len(_not_clearly_worse(FLIPS[:1], scores, 0)) == 1


def test_no_flips_cost_nothing() -> None:
    scan = scan_of(sample_mesh(BLOCK, 3_000, np.random.default_rng(1)).points)
    assert flipped_poses(np.eye(4), FLIPS[:0], scan, SURFACE, 1.0, 1e-3) == []


def gain(mesh: Mesh, seed: int) -> float:
    # Truth: the samples lie on the part or on its twin, which the first mirror brings nearest to the part; noise of
    # 3e-4 sizes, and a pose that is off by as much as a registration may be.
    rng = np.random.default_rng(seed)
    points = sample_mesh(mesh, 6_000, rng).points
    if mesh is TWIN:
        flip = near_mirrors(PART, PART_SURFACE)[0] @ np.diag([-1.0, 1.0, 1.0, 1.0])
        points = pose.apply(flip, points)
    scan = prepare_scan(PointCloud(points + 3e-4 * PART.diagonal * rng.normal(size=points.shape)))
    T = pose.from_parts(np.eye(3), 1e-4 * PART.diagonal * rng.normal(size=3))
    return gain_of_mirror(
        T,
        near_mirrors(PART, PART_SURFACE),
        scan,
        PART_SURFACE,
        0.05 * PART.diagonal,
        smallest_kernel_scale(scan, PART_SURFACE),
    )


def test_a_near_mirror_has_determinant_minus_one_and_moves_little():
    (mirror,) = near_mirrors(PART, PART_SURFACE)
    assert np.linalg.det(mirror[:3, :3]) == pytest.approx(-1.0, abs=1e-12)
    sample = sample_mesh(PART, 4_000, np.random.default_rng(0)).points
    off = PART_SURFACE.closest(pose.apply(mirror, sample)).distances
    assert 0.7 < np.mean(off < 5e-3 * PART.diagonal) < 0.998


@pytest.mark.parametrize("shape", [box((3.0, 2.0, 1.0)), box((2.0, 2.0, 2.0))])
def test_what_is_its_own_mirror_image_has_no_twin(shape):
    mesh = Mesh(*shape)
    assert len(near_mirrors(mesh, MeshSurface(mesh))) == 0


def test_without_a_mirror_nothing_is_gained():
    scan = prepare_scan(PointCloud(sample_mesh(PART, 1_000, np.random.default_rng(0)).points))
    assert gain_of_mirror(np.eye(4), np.zeros((0, 4, 4)), scan, PART_SURFACE, 1.0, 1e-3) == -np.inf


@pytest.mark.parametrize("seed", range(3))
def test_the_twin_gains_in_the_mirror_and_the_part_loses(seed):
    # A tenth of the bracket's surface is the difference: far from the limit on either side.
    assert gain(TWIN, seed) > 10.0 * MIRRORED
    assert gain(PART, seed) < -10.0 * MIRRORED


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
    steps = ring_steps(part, MeshSurface(part))
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
    steps = ring_steps(mesh, MeshSurface(mesh))
    assert np.abs(np.array([angle_of(R) for R in steps]) - np.deg2rad(72.0)).min() <= 1e-9


def test_a_disc_that_one_thing_breaks_has_no_step() -> None:
    mesh = spoilt(cylinder(diameter=120.0, height=20.0, segments=96), 120.0)
    assert ring_steps(mesh, MeshSurface(mesh)) == []


@pytest.mark.parametrize("part", [bracket(), block()], ids=["plain", "block"])
def test_what_has_no_teeth_has_no_step(part: tuple) -> None:
    mesh = Mesh(*part)
    assert ring_steps(mesh, MeshSurface(mesh)) == []


def test_the_facets_of_a_cylinder_are_its_symmetry_and_no_flips() -> None:
    mesh = Mesh(*cylinder())
    surface = MeshSurface(mesh)
    assert all(is_symmetry(T, mesh, surface) for T in near_flips(mesh, surface))


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
