"""Walls dented by more than half of their thickness: the nearest side is then the other one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, PointCloud
from dqreg.inspection import Deviations, decide, inspect, measure_deviations, nearest_face, part_faces, thickness_of
from dqreg.inspection.deviations.facing_sides import Facing
from dqreg.inspection.deviations.measure import deviations_under
from dqreg.inspection.plan.file import plan_of
from dqreg.registration.register import register
from dqreg.report.decision_tables import decision_words
from dqreg.synth.parts import box

SIZE = np.array([60.0, 40.0, 1.0])  # A sheet, mm
NOISE = 0.01


def sheet(unit: float) -> Mesh:
    mesh = Mesh(*box(tuple(unit * SIZE)))
    return Mesh(mesh.vertices - mesh.centre, mesh.faces)


def scan(depth: float, side: float, sharp: bool, seed: int, *, both: bool = False) -> tuple[FloatArray, FloatArray]:
    """Points of one side of the sheet, or both, dented into it, and how deep each lies; a sharp dent has no flanks."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, size=(12_000, 3)) * SIZE
    away = np.linalg.norm(points[:, :2] - rng.uniform(-5.0, 5.0, size=2), axis=1)
    dent = np.where(away < 6.0, depth, 0.0) if sharp else depth * np.exp(-0.5 * (away / 4.0) ** 2)
    sides = np.where(rng.uniform(size=len(points)) < 0.5, 1.0, -1.0) if both else np.full(len(points), side)
    truth = -dent * np.where(sides == side, 1.0, -1.0)
    points[:, 2] = sides * (0.5 * SIZE[2] + truth + rng.normal(0.0, NOISE, size=len(points)))
    return points, truth


def measured(points: FloatArray, unit: float, facing: Facing | None = None) -> Deviations:
    mesh, limit = sheet(unit), 0.05 * unit * float(np.linalg.norm(SIZE))
    surface, noise, tolerance = MeshSurface(mesh), unit * NOISE, 0.5 * unit
    return measure_deviations(
        unit * points, mesh, surface, limit=limit, noise=noise, tolerance=tolerance, facing=facing
    )


def knowledge(kind: str, points: FloatArray, side: float, unit: float) -> Facing:
    up = np.array([0.0, 0.0, side])
    if kind == "viewpoint":
        return Facing.by_sight(300.0 * unit * up)
    return Facing.by_normals(np.tile(up, (len(points), 1)), np.eye(3))


def dents(deepest: float) -> list[Any]:
    """Depth of a dent, whether it is sharp, and the unit in mm; each in the other unit with the long tests."""
    kinds = [(0.7, False, 1.0), (1.0, False, 1e-3), (1.0, True, 1.0), (deepest, False, 1e-3)]
    others = (pytest.param(depth, sharp, 1e-3 / unit, marks=pytest.mark.soak) for depth, sharp, unit in kinds)
    return [*kinds, *others]


@pytest.mark.parametrize("kind", ["normals", "viewpoint"])
@pytest.mark.parametrize(("depth", "sharp", "unit"), dents(1.6))
def test_a_dent_is_as_deep_as_it_is_where_the_scan_has_sides(unit: float, kind: str, depth: float, sharp: bool) -> None:
    for side in (1.0, -1.0):
        points, truth = scan(depth, side, sharp, 20_000)
        found = measured(points, unit, knowledge(kind, points, side, unit))
        np.testing.assert_allclose(found.values / unit, truth, rtol=0.0, atol=6.0 * NOISE)
        decision = decide(found)
        assert decision.outcome == "fail"
        assert not decision.codes
        # What is moved on, by a plan's alignment, stays on its side.
        after = deviations_under(found, np.eye(4), np.zeros((6, 6)), np.zeros(3))
        np.testing.assert_allclose(after.values, found.values, rtol=0.0, atol=1e-12 * unit)


@pytest.mark.parametrize(("depth", "sharp", "unit"), dents(1.3))
def test_without_sides_such_a_dent_is_undecided(unit: float, depth: float, sharp: bool) -> None:
    for side, seed in ((1.0, 20_000), (-1.0, 20_001), (1.0, 20_002)):
        points, truth = scan(depth, side, sharp, seed)
        found = measured(points, unit)
        decision = decide(found)
        assert decision.outcome == "undecided"
        assert decision.codes == ("wall_side",)
        doubt = decision.wall_doubts[0]
        assert doubt.thickness == pytest.approx(unit * SIZE[2])
        nearest = np.linalg.norm(unit * points - doubt.position, axis=1).argmin()
        assert truth[nearest] < -0.5 * SIZE[2]
        assert any("give --viewpoint" in words and "wall_side" in words for words in decision_words(decision, "", True))


@pytest.mark.parametrize("known", ["normals", "viewpoint in the file", "viewpoint", ""])
def test_a_registered_scan_is_measured_on_its_side_where_it_tells(known: str) -> None:
    points, truth = scan(1.0, 1.0, False, 20_006)
    mesh, eye = sheet(1.0), np.array([0.0, 0.0, 300.0])
    # One rim fixes the sheet in its plane.
    rim = np.random.default_rng(0).uniform(-0.5, 0.5, size=(1_000, 3)) * SIZE
    rim[:500, 0], rim[500:, 1] = -0.5 * SIZE[0], -0.5 * SIZE[1]
    normals = np.tile([0.0, 0.0, 1.0], (len(points) + len(rim), 1))
    normals[len(points) :] = np.repeat([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], 500, axis=0)
    cloud = PointCloud(
        np.concatenate([points, rim]),
        normals=normals if known == "normals" else None,
        viewpoint=eye if "file" in known else None,
    )
    result = register(cloud, mesh, np.eye(4), viewpoint=eye if known == "viewpoint" else None)
    found = result.deviations(tolerance=0.5)
    decision = decide(found)
    if not known:
        assert (decision.outcome, decision.codes) == ("undecided", ("wall_side",))
        return
    np.testing.assert_allclose(found.values[: len(points)], truth, rtol=0.0, atol=0.1)
    assert decision.outcome == "fail"
    assert not decision.codes


@pytest.mark.parametrize(
    ("depth", "both"),
    [
        (0.0, False),
        (0.35, True),
        *(pytest.param(*case, marks=pytest.mark.soak) for case in ((0.0, True), (0.35, False))),
    ],
)
def test_sheets_without_such_a_dent_pass(depth: float, both: bool) -> None:
    for seed in range(20_000, 20_010):
        points, _ = scan(depth, 1.0, False, seed, both=both)
        assert decide(measured(points, 1.0)).outcome == "pass"


def test_a_side_that_was_scanned_in_patches_is_none_in_doubt() -> None:
    # Below where the other side has a hole there are points of both around it.
    points, _ = scan(0.0, 1.0, False, 20_003, both=True)
    away = np.linalg.norm(points[:, :2], axis=1)
    found = measured(points[(points[:, 2] < 0.0) | (away > 8.0)], 1.0)
    assert not found.wall_doubts


def test_normals_that_are_inside_out_are_not_believed() -> None:
    points, truth = scan(0.0, 1.0, False, 20_004)
    found = measured(points, 1.0, knowledge("normals", points, -1.0, 1.0))
    np.testing.assert_allclose(found.values, truth, rtol=0.0, atol=6.0 * NOISE)


@pytest.mark.parametrize("seed", range(20_010, 20_016))
def test_normals_of_random_signs_are_not_believed(seed: int) -> None:
    # As estimated ones are that nobody oriented: half of them look away, give or take.
    points, truth = scan(0.0, 1.0, False, seed)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(points))
    found = measured(points, 1.0, Facing.by_normals(np.outer(signs, [0.0, 0.0, 1.0]), np.eye(3)))
    np.testing.assert_allclose(found.values, truth, rtol=0.0, atol=6.0 * NOISE)


def test_the_thickness_of_a_wall_is_measured_from_its_own_sides() -> None:
    # Both sides are dented alike: the wall stays as thick as it was, however deep the dent.
    points, truth = scan(0.8, 1.0, True, 20_005, both=True)
    normals = np.zeros_like(points)
    normals[:, 2] = np.where(points[:, 2] > np.where(truth == 0.0, 0.0, -0.8), 1.0, -1.0)
    found, mesh = measured(points, 1.0, Facing.by_normals(normals, np.eye(3))), sheet(1.0)
    wall = thickness_of(found, nearest_face(mesh, part_faces(mesh), (0.0, 0.0, 0.5)).number)
    middle = points[truth != 0.0].mean(axis=0)
    dented = np.linalg.norm((wall.positions - middle)[:, :2], axis=1) < 4.0
    assert np.count_nonzero(dented) > 20
    np.testing.assert_allclose(wall.values[dented], 1.0, rtol=0.0, atol=4.0 * NOISE)


def pitted(depth: float, power: float, seed: int, *, gap: float = 0.0) -> PointCloud:
    """Both sides of the sheet, the lower one pitted; nothing of that where it has a gap."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, size=(12_000, 3)) * SIZE
    lower, away = rng.uniform(size=len(points)) < 0.5, np.linalg.norm(points[:, :2], axis=1)
    pit = depth * np.exp(-((away / 6.0) ** power))
    points[:, 2] = np.where(lower, pit - 0.5 * SIZE[2], 0.5 * SIZE[2]) + rng.normal(0.0, NOISE, len(points))
    kept = ~lower | (away >= gap)
    return PointCloud(points[kept], normals=np.where(lower, -1.0, 1.0)[kept, None] * [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("depth", "power", "seeds"),
    [
        (0.7, 4.0, [63_041]),
        (0.85, 2.0, [63_042]),
        pytest.param(0.7, 4.0, [63_042], marks=pytest.mark.soak),
        pytest.param(0.85, 2.0, [63_041], marks=pytest.mark.soak),
        pytest.param(0.9, 4.0, [63_041, 63_042], marks=pytest.mark.soak),
    ],
)
def test_a_pit_in_a_sheet_that_was_scanned_from_both_sides_is_undecided(
    depth: float, power: float, seeds: list[int]
) -> None:
    mesh = sheet(1.0)
    upper, lower = (nearest_face(mesh, part_faces(mesh), (0.0, 0.0, z)).number for z in (0.5, -0.5))
    rows = [{"name": "wall", "kind": "thickness", "face": face, "tolerance": 0.5} for face in (upper, lower)]
    plan = plan_of({"characteristic": rows})
    for seed in seeds:
        scan = pitted(depth, power, seed)
        found = measured(scan.points, 1.0)
        decision = decide(found)
        assert (decision.outcome, decision.codes) == ("undecided", ("wall_side",))
        assert np.linalg.norm(decision.wall_doubts[0].position[:2]) < 4.0
        for row in inspect(found, plan).characteristics:
            assert row.outcome == "undecided"
            assert row.nominal == pytest.approx(1.0)
            assert "cannot be told apart" in row.remark
        # With normals it is as thin as it is.
        assert scan.normals is not None
        known = measured(scan.points, 1.0, Facing.by_normals(scan.normals, np.eye(3)))
        assert not known.wall_doubts
        for row in inspect(known, plan).characteristics:
            assert row.value == pytest.approx(1.0 - depth, abs=0.06)


@pytest.mark.parametrize(("depth", "gap"), [(0.0, 8.0), (0.45, 0.0), (0.45, 5.0)])
def test_a_gap_or_a_shallow_pit_on_one_side_is_none_in_doubt(depth: float, gap: float) -> None:
    for seed in range(63_050, 63_056):
        assert not measured(pitted(depth, 4.0, seed, gap=gap).points, 1.0).wall_doubts
