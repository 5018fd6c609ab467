"""Meshes wound inward, or open: what is signed has the side that deviations have, or is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import (
    Deviations,
    FaceTerms,
    Inspection,
    align_surface,
    inspect,
    measure_deviations,
    part_faces,
    section_of,
    thickness_of,
)
from dqreg.inspection.alignment.surface_fit import Goal
from dqreg.inspection.plan.file import plan_of
from dqreg.report.section_picture import section_picture
from dqreg.synth.parts import box, bracket

SIZE, EXCESS, NOISE = (30.0, 20.0, 10.0), 0.2, 0.005
PART = Mesh(*box(SIZE))
INWARD = Mesh(PART.vertices, PART.faces[:, ::-1])
OPEN = Mesh(PART.vertices, np.delete(PART.faces, int(np.argmax(PART.face_normals[:, 0])), axis=0))
OPEN_INWARD = Mesh(OPEN.vertices, OPEN.faces[:, ::-1])
GOALS: tuple[Goal, ...] = ("outside", "best-fit", "inside")
NEAR = [0.0, 0.0, 0.5 * SIZE[2]]
WIDE, NARROW = {"plus": 0.3, "minus": 0.1}, {"plus": 0.1, "minus": 0.3}


def scanned(mesh: Mesh) -> Deviations:
    """The block with its top higher by 0.2."""
    cloud = sample_mesh(PART, 12_000, np.random.default_rng(63_000))
    points = cloud.points + np.random.default_rng(63_001).normal(0.0, NOISE, (12_000, 3))
    points[cloud.points[:, 2] > 0.4999 * SIZE[2], 2] += EXCESS
    return measure_deviations(points, mesh, MeshSurface(mesh), reach=2.0, noise=NOISE)


def inspected(mesh: Mesh, *rows: dict[str, Any]) -> Inspection:
    return inspect(scanned(mesh), plan_of({"characteristic": [{"name": str(k), **row} for k, row in enumerate(rows)]}))


@pytest.mark.parametrize("mesh", [PART, INWARD])
def test_the_excess_of_a_face_is_one_whichever_way_the_mesh_is_wound(mesh: Mesh) -> None:
    found = scanned(mesh)
    top = found.points[:, 2] > 0.5 * SIZE[2] + 0.5 * EXCESS
    assert np.median(found.values[top]) == pytest.approx(EXCESS, abs=NOISE)
    np.testing.assert_allclose(np.median(found.normals(np.flatnonzero(top)), axis=0), [0.0, 0.0, 1.0], atol=1e-12)
    cut = section_of(found, [0.0, 1.0, 0.0], [0.0, 1.0, 0.0])
    upper = (cut.positions[:, 2] > 0.4999 * SIZE[2]) & (np.abs(cut.positions[:, 0]) < 0.49 * SIZE[0])
    np.testing.assert_allclose(cut.outward[upper], [[0.0, 0.0, 1.0]] * np.count_nonzero(upper), atol=1e-12)
    assert np.nanmedian(cut.values[upper]) == pytest.approx(EXCESS, abs=NOISE)
    # A zone from 0.1 inside to 0.3 outside has its middle 0.1 outside: the face lies 0.1 from that. The other zone's
    # middle lies 0.1 inside, and the face 0.3 from it.
    within, beyond, wall = inspected(
        mesh,
        {"kind": "profile", "near": NEAR, **WIDE},
        {"kind": "profile", "near": NEAR, **NARROW},
        {"kind": "thickness", "near": NEAR, "tolerance": 0.3},
    ).characteristics
    assert abs(within.value - 0.2) <= within.uncertainty < 0.05
    assert abs(beyond.value - 0.6) <= beyond.uncertainty < 0.05
    assert (within.outcome, beyond.outcome) == ("pass", "fail")
    assert abs(wall.value - (SIZE[2] + EXCESS)) <= wall.uncertainty < 0.05


def test_no_place_is_left_on_the_other_side_of_a_mesh_wound_inward() -> None:
    top = {int(faces_of(PART)[1][int(np.argmax(PART.face_normals[:, 2]))]): FaceTerms()}
    shifts = []
    for mesh in (PART, INWARD):
        for goal in GOALS:
            found = align_surface(scanned(mesh), goal, faces=top, dof="tz")
            shifts.append(found.T_target_source[2, 3])
    outside, middle, inside = shifts[:3]
    assert outside > middle + 1e-3
    assert inside < middle - 1e-3
    assert shifts[3:] == pytest.approx(shifts[:3], abs=1e-9)


def test_faces_of_a_mesh_wound_inward_are_the_same() -> None:
    part = Mesh(*bracket())
    inward = Mesh(part.vertices, part.faces[:, ::-1])
    np.testing.assert_array_equal(faces_of(part)[1], faces_of(inward)[1])
    for one, other in zip(part_faces(part), part_faces(inward), strict=True):
        assert (one.kind, one.is_hole) == (other.kind, other.is_hole)
        if one.kind == "plane" and one.feature and other.feature:
            np.testing.assert_allclose(one.feature.axis, other.feature.axis, atol=1e-9)


@pytest.mark.parametrize("mesh", [OPEN, OPEN_INWARD])
def test_what_needs_a_side_is_refused_of_an_open_mesh(mesh: Mesh) -> None:
    words = "need signs: the mesh is not watertight .* close the mesh, or treat both sides alike"
    for limits in (WIDE, NARROW):
        with pytest.raises(InputError, match=f"characteristic '0': unequal sides of a tolerance {words}"):
            inspected(mesh, {"kind": "profile", "near": NEAR, **limits})
    with pytest.raises(InputError, match=f"alignments to the outside {words}"):
        align_surface(scanned(mesh), "outside", dof="tz")
    (row,) = inspected(mesh, {"kind": "profile", "near": NEAR, "tolerance": 0.5}).characteristics
    assert abs(row.value - 2.0 * EXCESS) <= row.uncertainty < 0.05
    found = inspect(
        scanned(mesh), plan_of({"tolerance": 0.5, "section": [{"name": "cut", "point": NEAR, "normal": [0, 1, 0]}]})
    )
    assert found.deviations is not None
    picture = section_picture(found.sections[0][1], "mm", signed=found.deviations.signed)
    assert "the mesh has no outside: signs are along the normals of its faces" in picture


def test_behind_an_open_mesh_wound_inward_lies_no_wall() -> None:
    number = int(faces_of(OPEN)[1][int(np.argmax(OPEN.face_normals[:, 2]))])
    assert abs(thickness_of(scanned(OPEN), number).value - (SIZE[2] + EXCESS)) < 0.05
    (row,) = inspected(OPEN_INWARD, {"kind": "thickness", "near": NEAR, "tolerance": 0.3}).characteristics
    assert (row.outcome, "wind its faces outward" in row.remark) == ("undecided", True)
