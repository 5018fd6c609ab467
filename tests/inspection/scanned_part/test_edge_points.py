"""Edge points: exact on exact geometry, and within their uncertainty where points and noise are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Deviations, edge_point, measure_deviations
from dqreg.inspection.features.edge import border_offset
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box, bracket

SIZES = np.array([30.0, 20.0, 10.0])
PART = Mesh(*box(tuple(SIZES)))
SURFACE = MeshSurface(PART)
# An open sheet in the plane z = 0, 40 by 20.
SHEET = Mesh([[-20, -10, 0], [20, -10, 0], [20, 10, 0], [-20, 10, 0.0]], [[0, 1, 2], [0, 2, 3]])
FAR = np.array([5e5, -4e5, 1e5])


def faces_of_block(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Points in a grid on the top and the right side of the block, and which are on top."""
    x, y, z = (np.arange(-0.5 * n + 0.5 * step, 0.5 * n, step) for n in SIZES)
    top = np.stack([a.ravel() for a in (*np.meshgrid(x, y), np.full((len(y), len(x)), 5.0))], axis=1)
    side = np.stack([a.ravel() for a in (np.full((len(z), len(y)), 15.0), *np.meshgrid(y, z))], axis=1)
    return np.vstack([top, side]), np.r_[np.ones(len(top), bool), np.zeros(len(side), bool)]


def test_faces_that_are_moved_and_tilted_meet_where_their_planes_do() -> None:
    points, top = faces_of_block(0.5)
    # The top is 0.03 higher and leans by 1 mrad about y; the side is 0.02 farther out and leans by 2 mrad about y.
    lean_top, lean_side = np.tan(1e-3), np.tan(2e-3)
    points[top, 2] += 0.03 + lean_top * points[top, 0]
    points[~top, 0] += 0.02 + lean_side * points[~top, 2]
    found = edge_point(measure_deviations(points, PART, SURFACE, reach=1.0), [15.1, 3.0, 5.1], radius=4.0)
    # By hand: z = 5 + 0.03 + a x and x = 15 + 0.02 + b z, in the section y = 3.
    x = (15.02 + lean_side * 5.03) / (1.0 - lean_side * lean_top)
    np.testing.assert_allclose(found.point, [x, 3.0, 5.03 + lean_top * x], atol=1e-12)
    assert found.kind == "meeting"
    np.testing.assert_allclose(found.nominal, [15.0, 3.0, 5.0], atol=1e-12)
    # The top is the larger face: the offset is measured in it.
    np.testing.assert_allclose(found.outward, [1.0, 0.0, 0.0], atol=1e-12)
    assert found.offset == pytest.approx(x - 15.0, abs=1e-12)
    other = edge_point(measure_deviations(points, PART, SURFACE, reach=1.0), [15, 3, 5], face=found.faces[1], radius=4)
    assert other.offset == pytest.approx(0.03 + lean_top * x, abs=1e-12)


def noisy(seed: int) -> float:
    """Error of the offset in standard deviations, of a block with noise along the normals."""
    rng = np.random.default_rng(seed)
    points, top = faces_of_block(0.5)
    points[top, 2] += rng.normal(0.0, 0.01, top.sum())
    points[~top, 0] += 0.05 + rng.normal(0.0, 0.01, np.count_nonzero(~top))
    found = edge_point(measure_deviations(points, PART, SURFACE, reach=1.0), [15.0, 3.0, 5.0])
    return (found.offset - 0.05) / found.sigma


@pytest.mark.parametrize("runs", [6, pytest.param(400, marks=pytest.mark.soak)])
def test_the_meeting_of_noisy_faces_is_within_its_uncertainty(runs: int) -> None:
    sizes = np.abs([noisy(seed) for seed in range(20_000, 20_000 + runs)])
    assert np.count_nonzero(sizes > 2.0) <= (2 if runs == 6 else 0.08 * runs)


def sheet_scan(seed: int, kind: str) -> tuple[np.ndarray, float]:
    """A sheet that is longer at its right end by a random amount, and by how much."""
    rng = np.random.default_rng(seed)
    end, angle = 0.4 * rng.uniform(-1, 1), rng.uniform(0, np.pi)
    if kind == "random":
        points = rng.uniform(-30, 30, (14_000, 2))
    else:
        side = np.arange(-30, 30, 0.5) + rng.uniform(0, 0.5)
        turn = angle if kind == "turned" else 0.0
        points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) + rng.normal(0, 0.02, 2)
        points = points @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    inside = (np.abs(points[:, 1]) <= 10.0) & (points[:, 0] >= -20.0) & (points[:, 0] <= 20.0 + end)
    return np.column_stack([points[inside], rng.normal(0.0, 0.01, inside.sum())]), end


@pytest.mark.parametrize("kind", ["random", "turned", "aligned"])
@pytest.mark.parametrize("runs", [12, pytest.param(400, marks=pytest.mark.soak)])
def test_the_border_of_a_sheet_is_within_its_uncertainty(kind: str, runs: int) -> None:
    surface, inside = MeshSurface(SHEET), []
    for seed in range(20_000, 20_000 + runs):
        points, end = sheet_scan(seed, kind)
        found = edge_point(measure_deviations(points, SHEET, surface, reach=2.0), [20.0, 1.0, 0.0])
        assert found.kind == "border"
        # Half a distance of neighbouring points is all that any pattern can hide.
        assert found.sigma < 0.25
        inside.append(abs(found.offset - end) <= 2.0 * found.sigma)
    assert np.count_nonzero(inside) >= (runs - 3 if runs == 12 else 0.92 * runs)


@pytest.mark.parametrize("end", [-0.3, 0.15, 0.3, 0.45, 1.2])
@pytest.mark.parametrize("units", [1.0, pytest.param(1e-3, marks=pytest.mark.soak)])
def test_a_sheet_that_is_too_long_is_as_long_as_it_is(end: float, units: float) -> None:
    # Of a lip of a spacing the points lie off the part, and are too few for a surface.
    mesh, errors = Mesh(units * SHEET.vertices, SHEET.faces), []
    for seed in range(63_060, 63_064):
        rng = np.random.default_rng(seed)
        side = np.arange(-30.0, 30.0, 0.3) + rng.uniform(0.0, 0.3)
        turn = rng.uniform(0.2, 0.6)
        flat = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        flat = flat @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        flat = flat[(np.abs(flat[:, 1]) <= 10.0) & (flat[:, 0] >= -20.0) & (flat[:, 0] <= 20.0 + end)]
        points = np.column_stack([flat, rng.normal(0.0, 0.01, len(flat))])
        # Of a table below, and strays beyond the border that are joined to nothing.
        table = rng.uniform(-30.0, 30.0, (8_000, 3)) * [1.0, 1.0, 0.0] - [0.0, 0.0, 3.0]
        strays = np.array([[21.5, 0.0, 0.0], [22.4, 2.0, 0.01], [21.9, -1.0, 0.0]])
        scan = units * np.vstack([points, table, strays])
        found = measure_deviations(scan, mesh, MeshSurface(mesh), limit=2.0 * units, noise=0.01 * units)
        edge = edge_point(found, units * np.array([20.0, 1.0, 0.0]))
        errors.append((edge.offset / units - end) / (edge.sigma / units))
        assert edge.sigma < 0.05 * units
    assert np.abs(errors).max() <= 3.0


def test_a_sheet_that_is_longer_than_was_looked_is_not_measured() -> None:
    points = np.random.default_rng(63_070).uniform([-20.0, -10.0, 0.0], [30.0, 10.0, 0.0], (12_000, 3))
    found = measure_deviations(points, SHEET, MeshSurface(SHEET), reach=12.0)
    assert "longer than the part by more than 2" in refused(found, [20.0, 1.0, 0.0], radius=2.0)
    assert edge_point(found, [20.0, 1.0, 0.0], radius=15.0).offset == pytest.approx(10.0, abs=0.3)


def test_a_dense_border_is_where_it_is() -> None:
    # Rows of points at distances of 0.01: half of one is all that can be missing.
    along, across = (a.ravel() for a in np.meshgrid(np.arange(-1, 1, 0.01), np.arange(-1, 0.3, 0.01)))
    for slope in (0.0, 0.02):
        below = across <= 0.2 + slope * along
        offset, sigma = border_offset(along[below], across[below], 0.01)
        assert offset == pytest.approx(0.2, abs=0.006)
        assert sigma < 0.006


def test_a_pose_moves_the_point_with_it() -> None:
    points, _ = faces_of_block(0.5)
    T = twist.exp([0.3, -0.2, 0.5, *FAR])
    moved = Mesh(pose.apply(T, PART.vertices) - FAR, PART.faces)
    scan = pose.apply(T, points) - FAR
    place = pose.apply(T, np.array([15.0, 3.0, 5.0])) - FAR
    found = edge_point(measure_deviations(scan, moved, MeshSurface(moved), origin=FAR, reach=1.0), place + FAR)
    np.testing.assert_allclose(found.point, place + FAR, atol=1e-9)
    assert abs(found.direction @ T[:3, 1]) == pytest.approx(1.0, abs=1e-9)


def test_the_rim_of_a_hole_is_an_edge_too() -> None:
    part = Mesh(*bracket())
    from dqreg.inspection import part_faces

    hole = next(f for f in part_faces(part) if f.feature and f.is_hole and abs(f.feature.diameter - 16.0) < 1e-4)
    assert hole.feature is not None
    rng = np.random.default_rng(0)
    angle, height, radius = rng.uniform(0, 2 * np.pi, 60_000), rng.uniform(0, 10, 60_000), rng.uniform(8.1, 20, 60_000)
    wall = np.column_stack([8.1 * np.cos(angle), 8.1 * np.sin(angle), height])
    top = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), 10.0)])
    scan = np.vstack([wall, top]) + hole.feature.point * [1, 1, 0]
    at = hole.feature.point * [1, 1, 0] + [8.0, 0.0, 10.0]
    found = edge_point(measure_deviations(scan, part, MeshSurface(part), reach=1.0), at)
    # The hole is wider by 0.1 in its radius, and its facets lie up to 0.017 inside of the circle.
    assert found.offset == pytest.approx(-0.1, abs=0.02)


def refused(deviations: Deviations, *args: object, **options: object) -> str:
    with pytest.raises((InputError, DegenerateGeometryError)) as told:
        edge_point(deviations, *args, **options)  # type: ignore[arg-type]
    return str(told.value)


def test_what_has_no_edge_point_is_told() -> None:
    points, top = faces_of_block(0.5)
    scan = measure_deviations(points, PART, SURFACE, reach=1.0)
    assert "no edge lies near the point: the nearest place of one is (15, 3, 5)" in refused(scan, [11, 3, 5.0])
    assert "three finite coordinates" in refused(scan, [11, 3])
    assert "does not end at the edge there" in refused(scan, [15, 3, 5], face=99)
    assert "radius must be a length above 0" in refused(scan, [15, 3, 5], radius=0)
    alone = measure_deviations(points[top], PART, SURFACE, reach=1.0)
    assert "was not scanned at the edge" in refused(alone, [15, 3, 5])
