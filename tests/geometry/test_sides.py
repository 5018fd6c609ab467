"""Whether given normals have a side: oriented ones do, those of a plane fit and of chance do not, thin sheets do."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.scan_measures import THINNED_POINTS
from dqreg.geometry.sides import have_sides, without_signs
from dqreg.rigid import pose
from tests.strategies import FloatArray
from tests.trust.shapes import box, cylinder, sphere

SHAPES = {"box": box, "cylinder": cylinder, "sphere": sphere}


def scanned(shape: str, count: int = 3_000, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    points, normals = SHAPES[shape](rng, count)
    R = pose.exp(np.r_[rng.normal(size=3), 0.0, 0.0, 0.0])[:3, :3]
    return (points + 1e-3 * rng.normal(size=points.shape)) @ R.T, normals @ R.T


@pytest.mark.parametrize("count", [3_000, THINNED_POINTS + 10_000])
@pytest.mark.parametrize("shape", SHAPES)
def test_oriented_normals_have_sides_and_those_of_chance_have_none(shape: str, count: int) -> None:
    points, normals = scanned(shape, count)
    assert have_sides(points, normals)
    assert have_sides(points, -normals)
    rng = np.random.default_rng(1)
    for wrong in (0.5, 0.2, 0.05):
        signs = np.where(rng.uniform(size=(count, 1)) < wrong, -1.0, 1.0)
        assert not have_sides(points, signs * normals)
    # A few are a mistake of the estimate, and the others have a side.
    assert have_sides(points, np.where(np.arange(count) % 500 == 0, -1.0, 1.0)[:, None] * normals)


@pytest.mark.parametrize("shape", SHAPES)
def test_patches_that_point_in_and_out_have_no_side(shape: str) -> None:
    # As the eigenvectors of a plane fit do, whose signs stay the same over a patch.
    points, normals = scanned(shape)
    fits = fit_planes(NeighbourTree(points), points, points)
    sides = np.sign(np.sin(9.0 * points).prod(axis=1))
    outward = fits.normals * np.sign((fits.normals * normals).sum(axis=1))[:, None]
    assert have_sides(points, outward)
    assert not have_sides(points, sides[:, None] * outward)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("thickness", [0.005, 0.02])
def test_both_sides_of_a_thin_sheet_are_sides(thickness: float, noise: float) -> None:
    rng = np.random.default_rng(2)
    count = 20_000
    up = rng.choice([-1.0, 1.0], count)
    points = np.column_stack([rng.uniform(0.0, 1.0, (count, 2)), 0.5 * thickness * up + noise * rng.normal(size=count)])
    normals = np.column_stack([np.zeros((count, 2)), up])
    assert have_sides(points, normals)
    assert have_sides(points, -normals)
    assert not have_sides(points, rng.choice([-1.0, 1.0], (count, 1)) * normals)


def test_too_few_points_tell_nothing() -> None:
    points, normals = scanned("sphere", 20)
    assert have_sides(points, np.random.default_rng(3).choice([-1.0, 1.0], (20, 1)) * normals)


def test_a_cloud_loses_no_more_than_normals_without_a_side() -> None:
    points, normals = scanned("box")
    kept = PointCloud(points, normals, units="mm")
    assert without_signs(kept) is kept
    assert without_signs(bare := PointCloud(points)) is bare
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (len(points), 1))
    found = without_signs(PointCloud(points, signs * normals, np.zeros(3), "mm"))
    assert found.normals is None
    assert found.viewpoint is not None
    np.testing.assert_array_equal(found.points, points)
    assert (found.units, found.dropped) == ("mm", 0)


def test_points_of_a_part_that_its_mesh_gave_normals_to_have_sides() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tetrahedron = Mesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    cloud = sample_mesh(tetrahedron, 2_000, np.random.default_rng(5))
    assert cloud.normals is not None
    assert have_sides(cloud.points, cloud.normals)
