from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh, MeshSurface
from dqreg.search.features import even_places
from dqreg.search.grids import PlaneGrid
from dqreg.synth.parts import bracket

BRACKET = Mesh(*bracket())
SURFACE = MeshSurface(BRACKET)
GRID = PlaneGrid(SURFACE, *even_places(BRACKET, SURFACE, 20_000), *BRACKET.bounds)


def test_planes_of_the_grid_are_the_surfaces_own_near_it():
    # Oracle: the surface. A node is a cell's half diagonal off at most, and so is what it says.
    rng = np.random.default_rng(0)
    points = even_places(BRACKET, SURFACE, 2_000)[0] + 0.01 * BRACKET.diagonal * rng.normal(size=(2_000, 3))
    exact, known = SURFACE.closest(points), GRID.closest(points)
    assert np.abs(known.distances - exact.distances).max() < 2.0 * GRID.cell
    same = np.einsum("ij,ij->i", known.normals, exact.normals) > 0.999
    assert same.mean() > 0.8
    np.testing.assert_allclose(known.distances[same], exact.distances[same], atol=GRID.cell)


def test_outside_nothing_is_near():
    found = GRID.closest((BRACKET.centre + 3.0 * BRACKET.diagonal)[None])
    assert np.isinf(found.distances).all()
    assert (found.normals == 0.0).all()
