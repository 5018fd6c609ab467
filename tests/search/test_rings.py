from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import width_floor
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis
from dqreg.search.flips import flipped, near_flips
from dqreg.search.rings import ring_steps
from dqreg.search.rotations import angle_of
from dqreg.synth.parts import block, bracket, cylinder, gear

UP = np.array([0.0, 0.0, 1.0])


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


@pytest.mark.parametrize("part", [bracket(), block()], ids=["plain", "block"])
def test_what_has_no_teeth_has_no_step(part: tuple) -> None:
    mesh = Mesh(*part)
    assert ring_steps(mesh, MeshSurface(mesh)) == []


def test_the_facets_of_a_cylinder_are_its_symmetry_and_no_flips() -> None:
    mesh = Mesh(*cylinder())
    assert len(near_flips(mesh, MeshSurface(mesh))) == 0


def test_a_pose_that_is_one_tooth_off_is_told() -> None:
    part = marked(18)
    surface = MeshSurface(part)
    noise = 2e-4 * part.diagonal
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 20_000, rng).points
    # The scan is made in the part's frame: the truth is the identity, and this is one tooth away from it.
    scan = prepare_scan(PointCloud(points + noise * rng.normal(size=points.shape)), 2_000)
    wrong = pose.from_parts(about_axis(UP, 2.0 * np.pi / 18), np.zeros(3))
    flips, limit, floor = near_flips(part, surface), 0.05 * part.diagonal, width_floor(scan, surface)
    found = flipped(wrong, flips, scan, surface, limit, floor)
    assert min(pose.angle_between(T, np.eye(4)) for T, _ in found) <= 2e-3
    # And from the truth none of the others is as good.
    assert flipped(np.eye(4), flips, scan, surface, limit, floor) == []
