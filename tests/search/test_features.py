from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NORMAL_NEIGHBOURS
from dqreg.search.features import edge_points, even_points, rarity, scan_features, target_features
from dqreg.synth.parts import box


def square(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1, 1, (n, 2)), np.zeros(n)])


def test_edges_of_a_square_lead_off_it():
    points = square(8_000, 0)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    found, outwards = edge_points(points, NeighbourTree(points).nearest(points, NORMAL_NEIGHBOURS)[0], points, normals)
    # Sixteen neighbours reach about four spacings: 0.09.
    depth = 1.0 - np.abs(points[:, :2]).max(axis=1)
    assert found[depth < 0.005].mean() > 0.9
    # Points strewn at random are lopsided here and there; those of a scan are not.
    assert found[depth > 0.1].mean() < 0.1
    np.testing.assert_allclose(np.linalg.norm(outwards[found], axis=1), 1.0, atol=1e-12)
    # Away from the corners the way off is the nearest side's.
    side = found & (depth < 0.02) & (np.abs(points[:, :2]).min(axis=1) < 0.8)
    axis = np.abs(points[side, :2]).argmax(axis=1)
    straight = outwards[side][np.arange(side.sum()), axis] * np.sign(points[side, :2][np.arange(side.sum()), axis])
    assert np.median(straight) > 0.95


def test_rarity_gives_each_direction_the_root_of_its_share():
    normals = np.repeat([[0.0, 0, 1], [0, 0, -1], [1, 0, 0]], [60, 40, 4], axis=0)
    weights = rarity(normals)
    np.testing.assert_allclose(weights[:100], 0.1)
    np.testing.assert_allclose(weights[100:], 0.5)


@pytest.mark.parametrize("outliers", [0, 800])
def test_points_of_a_scan_are_on_it_however_many_outliers(outliers):
    rng = np.random.default_rng(1)
    cloud = PointCloud(np.concatenate([square(2_000, 0), rng.uniform(-1, 1, (outliers, 3))]))
    points = scan_features(prepare_scan(cloud), 3.0)
    drawn = points.draw(5_000, rng)
    on = (np.abs(points.points[drawn, 2]) < 0.05) & (np.abs(points.directions[drawn, 2]) > 0.9)
    faces = ~points.is_edge[drawn]
    assert on[faces].mean() > 0.95
    assert 0.2 < points.is_edge[drawn].mean() < 0.5


def test_edges_of_a_box_are_its_twelve_edges():
    mesh = Mesh(*box((3.0, 2.0, 1.0), divisions=3))
    features, edges = target_features(mesh, even_points(mesh, MeshSurface(mesh), 8_000), 400)
    at_limit = np.isclose(np.abs(edges), [1.5, 1.0, 0.5]).sum(axis=1)
    assert (at_limit >= 2).all()
    # A way off a face of a box is a normal of another face, and leads out of the box.
    at_edge = features.is_edge
    assert at_edge.sum() == 100
    assert (np.isclose(np.abs(features.directions[at_edge]), 1.0).sum(axis=1) == 1).all()
    assert (np.einsum("ij,ij->i", features.directions[at_edge], features.points[at_edge]) > 0.0).all()
    assert len(features.points) <= 400


def test_nothing_to_draw_draws_nothing():
    # Points on a curve so thin that no plane can be fitted anywhere.
    line = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)])
    points = scan_features(prepare_scan(PointCloud(line)), 1.0)
    assert len(points.draw(10, np.random.default_rng(0))) == 0
