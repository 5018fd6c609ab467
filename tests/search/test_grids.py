from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.search.features import even_points
from dqreg.search.grids import MAX_CELLS, MAX_PADDED_RATIO, NODE_HALVINGS, DistanceGrid, Edges, OccupancyGrid, PlaneGrid
from dqreg.search.poses import Poses
from dqreg.synth.parts import box, bracket

BRACKET = Mesh(*bracket())
SURFACE = MeshSurface(BRACKET)
GRID = PlaneGrid(SURFACE, even_points(BRACKET, SURFACE, 20_000), *BRACKET.bounds)


def test_planes_of_the_grid_are_the_surfaces_own_near_it():
    # Oracle: the surface. A node is a cell's half diagonal off at most, and so is what it says.
    rng = np.random.default_rng(0)
    points = even_points(BRACKET, SURFACE, 2_000).points + 0.01 * BRACKET.diagonal * rng.normal(size=(2_000, 3))
    exact, known = SURFACE.closest(points), GRID.closest(points)
    assert np.abs(known.distances - exact.distances).max() < 2.0 * GRID.cell
    same = np.einsum("ij,ij->i", known.normals, exact.normals) > 0.999
    assert same.mean() > 0.8
    np.testing.assert_allclose(known.distances[same], exact.distances[same], atol=GRID.cell)


def test_outside_nothing_is_near():
    found = GRID.closest((BRACKET.centre + 3.0 * BRACKET.diagonal)[None])
    assert np.isinf(found.distances).all()
    assert (found.normals == 0.0).all()


def test_points_outside_the_grid_count_nothing():
    mesh = Mesh(*box())
    grid = DistanceGrid(mesh.vertices, *mesh.bounds, mesh.diagonal)
    far = np.array([[0.0, 0.0, 1e6]])
    assert grid.scores(Poses(np.eye(3)[None], far), np.zeros((4, 3)), 0.1).tolist() == [0.0]


def test_occupancy_is_one_on_the_scan_and_nothing_far_off():
    points = sample_mesh(BRACKET, 20_000, np.random.default_rng(3)).points
    grid = OccupancyGrid(points, BRACKET.diagonal)
    far = np.eye(4)
    far[0, 3] = 3.0 * BRACKET.diagonal
    scores = grid.scores(Poses.of(np.stack([np.eye(4), far])), points[:200])
    assert scores[0] == pytest.approx(1.0, abs=1e-6)
    assert scores[1] == 0.0


def test_distances_of_the_grid_are_those_of_the_nearest_point_to_a_fraction_of_a_cell() -> None:
    # Oracle: the tree. Nodes hold what coarser ones hand down, which may be another one than the nearest.
    points = even_points(BRACKET, SURFACE, 20_000).points
    grid = DistanceGrid(points, *BRACKET.bounds, BRACKET.diagonal)
    nodes = grid.low + grid.cell * np.stack(np.unravel_index(np.arange(grid.count), grid.shape), axis=1)
    away = NeighbourTree(points).nearest(nodes, 1)[1][:, 0]
    held = np.linalg.norm(nodes - points[grid.held], axis=1)
    np.testing.assert_allclose(grid.distances, held, rtol=1e-5, atol=1e-6 * BRACKET.diagonal)
    too_far = (held - away) / grid.cell
    assert too_far.min() > -1e-9
    assert too_far.max() < 2.0 ** (NODE_HALVINGS - 1)
    assert too_far.mean() < 0.15


def test_edges_on_the_grid_are_as_near_as_the_nearest_up_to_a_cell() -> None:
    # Oracle: the tree. A point is half the diagonal of a cell off its node at most, and so the two edges' distances.
    rng = np.random.default_rng(0)
    places = rng.uniform(*BRACKET.bounds, size=(500, 3))
    edges = Edges.of(places, *BRACKET.bounds, BRACKET.diagonal)
    points = np.concatenate([rng.uniform(*BRACKET.bounds, size=(3_000, 3)), [BRACKET.centre + 2.0 * BRACKET.diagonal]])
    exact, (found, distances) = edges.closest(points, on_grid=False), edges.closest(points, on_grid=True)
    inside = slice(0, -1)
    away = np.linalg.norm(points - found, axis=1)[inside]
    assert (away >= exact[1][inside] - 1e-12).all()
    assert (away <= exact[1][inside] + np.sqrt(3.0) * edges.grid.cell).all()
    np.testing.assert_allclose(distances[inside], np.maximum(away - edges.grid.cell, 0.0), atol=1e-12)
    assert distances[-1] == np.inf


@pytest.mark.parametrize("length", [1.0, 1e3, 1e9, 1e15])
def test_a_long_thin_scan_takes_no_more_cells_than_others(length: float) -> None:
    points = np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]])
    assert OccupancyGrid(points, 1.0).count <= 2 * MAX_PADDED_RATIO * MAX_CELLS
