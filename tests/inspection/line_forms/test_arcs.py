"""Bores with form error that were scanned on a part of their way round: values cover the truth, or are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Inspection, inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import angle, bracket

NOISE, LOBES = 0.008, 0.04
PART = Mesh(*bracket())
# The bore of the bracket's boss, along x.
BORE, RADIUS = np.array([11.0, 32.0, 40.0]), 7.0
KINDS = ("diameter", "position", "form")


def inspected(points: np.ndarray, mesh: Mesh, near: Any, kinds: tuple[str, ...]) -> Inspection:
    rows = [{"name": k, "kind": k, "near": [float(x) for x in near], "tolerance": 0.1} for k in kinds]
    found = measure_deviations(points, mesh, MeshSurface(mesh), reach=2.0, noise=NOISE)
    return inspect(found, plan_of({"characteristic": rows}))


def lobed(rng: np.random.Generator, arc_deg: float) -> np.ndarray:
    """The bracket with three lobes of the bore, which is seen on an arc."""
    cloud = sample_mesh(PART, 40_000, rng)
    normals = PART.face_normals[MeshSurface(PART).closest(cloud.points).elements]
    around = (cloud.points - BORE) * [0, 1, 1]
    on = (np.abs(np.linalg.norm(around, axis=1) - RADIUS) < 0.1) & (np.abs(normals[:, 0]) < 0.1)
    turn = np.arctan2(around[:, 2], around[:, 1])
    radius = (
        RADIUS + 0.5 * LOBES * np.cos(3.0 * turn + float(rng.uniform(0.0, 6.0))) + rng.normal(0.0, NOISE, len(turn))
    )
    points = cloud.points + rng.normal(0.0, NOISE, (len(turn), 1)) * normals
    wall = np.column_stack([cloud.points[:, 0], BORE[1] + radius * np.cos(turn), BORE[2] + radius * np.sin(turn)])
    points[on] = wall[on]
    seen = np.degrees(turn - float(rng.uniform(0.0, 6.0))) % 360.0 < arc_deg
    return points[~on | seen]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("arc_deg", [60.0, 110.0, 150.0])
def test_form_that_an_arc_hides_is_not_taken_for_size(arc_deg: float, seed: int) -> None:
    points = lobed(np.random.default_rng(23_000 + seed), arc_deg)
    for row in inspected(points, PART, BORE - [0, 0, RADIUS], KINDS).characteristics:
        assert not row.measured
        assert row.outcome == "undecided"
        assert f"seen on {arc_deg:.0f} of 3" in row.remark or f"seen on {arc_deg - 1:.0f} of 3" in row.remark
        assert f"at least half of them are needed for its {row.kind}" in row.remark


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("arc_deg", [250.0, 360.0])
def test_a_bore_that_was_seen_is_measured(arc_deg: float, seed: int) -> None:
    points = lobed(np.random.default_rng(23_100 + seed), arc_deg)
    rows = inspected(points, PART, BORE - [0, 0, RADIUS], KINDS).characteristics
    for row, truth in zip(rows, (2.0 * RADIUS, 0.0, LOBES), strict=True):
        assert abs(row.value - truth) <= row.uncertainty < 2.0 * LOBES


def test_a_face_that_goes_round_a_part_of_a_turn_only_is_measured_where_it_was_scanned() -> None:
    mesh = Mesh(*angle(length=30.0, height=30.0, width=40.0, bend_radius=4.0, large_hole=3.0, small_hole=2.0))
    faces = [face for face in part_faces(mesh) if face.kind == "cylinder" and not face.is_hole]
    bend = max(faces, key=lambda face: face.area)
    assert bend.feature is not None
    rng = np.random.default_rng(23_200)
    points = sample_mesh(mesh, 20_000, rng).points
    near = points[np.argmin(np.linalg.norm(points - bend.centre, axis=1))]
    if nearest_face(mesh, part_faces(mesh), near).number != bend.number:
        near = mesh.corners[MeshSurface(mesh).closest(bend.centre[None]).elements[0]].mean(axis=0)
    row = inspected(points, mesh, near, ("diameter",)).characteristics[0]
    assert row.measured
    # Its points lie on facets.
    assert row.value == pytest.approx(bend.feature.diameter, rel=0.02)
