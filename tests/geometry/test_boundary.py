from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface, Mesh, PointCloud, sample_mesh
from dqreg.geometry.boundary import STRIP_AREA_SHARE, CloudBoundary
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.synth.parts import box, bracket


def grid(nx: int, ny: int, x: float = 1.0, at: float = 0.0) -> tuple[FloatArray, FloatArray]:
    u, v = np.meshgrid(np.linspace(at, at + x, nx + 1), np.linspace(0.0, 1.0, ny + 1), indexing="ij")
    i = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]), faces


def test_a_closed_mesh_has_no_borders() -> None:
    assert Mesh(*bracket()).borders is None
    assert len(Mesh(*bracket()).topology.free_sides) == 0


@pytest.mark.parametrize("cells", [1, 3, 40])
def test_near_is_the_distance_from_the_outline_however_the_mesh_is_divided(cells: int) -> None:
    sheet = Mesh(*grid(cells, cells))
    places = np.column_stack([np.random.default_rng(0).uniform(size=(2000, 2)), np.zeros(2000)])
    apart = np.minimum(places[:, :2], 1.0 - places[:, :2]).min(axis=1)
    borders = sheet.borders
    assert borders is not None
    for margin in (1e-4, 1e-3, 0.02):
        np.testing.assert_array_equal(borders.near(places, margin), apart <= margin)
    # A tenth of the area by the length of the outline.
    assert borders.widest == pytest.approx(STRIP_AREA_SHARE / 4.0)
    np.testing.assert_array_equal(borders.near(places, 0.4), apart <= STRIP_AREA_SHARE / 4.0)
    assert borders.near(np.zeros((0, 3)), 0.1).tolist() == []


def test_places_on_the_outline_are_near_at_no_margin_at_all() -> None:
    # Without the faces that look up, a box ends along four edges: what lies above it is closest to them.
    whole = Mesh(*box((3.0, 2.0, 1.0)))
    cup = Mesh(whole.vertices, whole.faces[whole.face_normals[:, 2] < 0.5])
    rim = sample_mesh(whole, 3000, np.random.default_rng(1)).points
    top = rim[:, 2].max()
    on = np.clip(rim, *cup.bounds)
    on[:, 0] = np.where(rim[:, 0] > 0.0, cup.bounds[1, 0], cup.bounds[0, 0])
    on[:, 2] = top
    assert cup.borders is not None
    assert cup.borders.near(on, 0.0).all()
    assert not cup.borders.near(on - [0.0, 0.0, 1e-6], 0.0).any()


@pytest.mark.parametrize("other", [1, 3, 7])
def test_a_seam_that_was_never_sewn_is_no_border(other: int) -> None:
    # Two halves of one sheet that divide their common edge differently.
    (v1, f1), (v2, f2) = grid(2, 5, x=0.5), grid(2, other, x=0.5, at=0.5)
    sheet = Mesh(np.concatenate([v1, v2]), np.concatenate([f1, f2 + len(v1)]))
    borders = sheet.borders
    assert borders is not None
    y = np.linspace(0.05, 0.95, 50)
    seam = np.column_stack([np.full(50, 0.5), y, np.zeros(50)])
    assert not borders.near(seam, 0.0).any()
    assert borders.near(seam + np.array([0.5, 0.0, 0.0]), 0.0).all()


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


@pytest.mark.parametrize(("lined", "asked"), [(0, 100), (4_000, 100), (800, 500)])
def test_a_fifth_of_the_sample_decides_where_it_is_clear_that_a_cloud_lies_in_lines(
    monkeypatch: pytest.MonkeyPatch, lined: int, asked: int
) -> None:
    # So many of 4,000 points in each of 40 lines far apart, and the others on a sheet beside them, in Morton order.
    rng = np.random.default_rng(0)
    lines = np.column_stack([rng.uniform(size=lined), 10.0 * rng.integers(1, 41, size=lined), np.zeros(lined)])
    points = np.vstack([rng.uniform(size=(4_000 - lined, 3)) * [1.0, 1.0, 0.0], lines])
    points = points[morton_order(points)]
    tree, looked_at = NeighbourTree(points), []
    nearest_to = tree.nearest_to
    monkeypatch.setattr(tree, "nearest_to", lambda rows, count: looked_at.append(len(rows)) or nearest_to(rows, count))
    assert CloudBoundary(tree, points).in_lines == (lined > 2_000)
    assert looked_at[-1] == asked
