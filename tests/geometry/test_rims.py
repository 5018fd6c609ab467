from __future__ import annotations

import numpy as np

from dqreg.geometry import CloudSurface, Mesh, PointCloud, sample_mesh
from dqreg.geometry.boundary import CloudBoundary
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.synth.parts import box


def test_the_rim_of_a_patch_is_its_outline_and_little_else() -> None:
    points = np.column_stack([np.random.default_rng(0).uniform(size=(10_000, 2)), np.zeros(10_000)])
    rims = CloudBoundary(NeighbourTree(points), points)
    rim = rims.at(np.arange(len(points)), np.tile([0.0, 0, 1], (len(points), 1)))
    inside = np.minimum(points[:, :2], 1.0 - points[:, :2]).min(axis=1)
    # Spacing is 0.005 about.
    assert rim[inside < 0.003].mean() > 0.9
    assert rim[inside > 0.03].mean() < 0.1


def test_a_closed_body_has_hardly_any_rim_not_even_at_its_sharp_edges() -> None:
    part = Mesh(*box((3.0, 2.0, 1.0)))
    surface = CloudSurface(sample_mesh(part, 10_000, np.random.default_rng(0)))
    found = surface.closest(surface._points)
    assert surface.on_rim(found).mean() < 0.1


def test_a_cloud_swept_in_lines_has_no_rim_because_it_ends_everywhere() -> None:
    along, rings = np.meshgrid(np.linspace(0, 1, 400), np.linspace(0, 1, 12), indexing="ij")
    surface = CloudSurface(PointCloud(np.column_stack([along.ravel(), rings.ravel(), np.zeros(along.size)])))
    assert not surface.on_rim(surface.closest(surface._points)).any()


def test_asking_in_parts_or_twice_or_for_a_row_twice_answers_the_same() -> None:
    points = np.random.default_rng(3).uniform(size=(2000, 3)) * [1.0, 1.0, 0.01]
    up = np.tile([0.0, 0, 1], (2000, 1))
    once = CloudBoundary(NeighbourTree(points), points).at(np.arange(2000), up)
    parts = CloudBoundary(NeighbourTree(points), points)
    rows = np.random.default_rng(4).integers(0, 2000, size=3000)
    np.testing.assert_array_equal(parts.at(rows, up[rows]), once[rows])
    np.testing.assert_array_equal(parts.at(np.arange(2000), up), once)
