"""Suggested plans: coordinates with the digits that the part's size carries, wherever its origin is."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest

from dqreg.geometry import Mesh
from dqreg.inspection.part_faces import part_faces
from dqreg.inspection.plan.round_faces import is_arc
from dqreg.inspection.plan.suggested_plan import suggested_plan
from dqreg.synth.parts import box, bracket, cylinder


def written(scale: float, origin: tuple[float, float, float]) -> list[list[str]]:
    """The middles of faces as a suggested plan writes them, of a box whose corners carry rounding."""
    corners, faces = box((3.0 * scale, 2.0 * scale, scale))
    rounding = 1e-16 * scale * np.random.default_rng(0).normal(size=corners.shape)
    text = suggested_plan(Mesh(corners + rounding + origin, faces))
    return [found.split(", ") for found in re.findall(r"middle at \((.*)\)", text)]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0, 1e5])
def test_rounding_of_coordinates_is_not_written(scale: float) -> None:
    middles = written(scale, (0.0, 0.0, 0.0))
    assert len(middles) >= 6
    # Of a box about its origin each face's middle has two zeros: in digits of its size nothing is left of rounding.
    assert all(sum(each == "0" for each in row) == 2 for row in middles)
    assert max(len(each.strip("-")) for row in middles for each in row) <= 7


def test_a_far_origin_takes_no_digits() -> None:
    near, far = written(1.0, (0.0, 0.0, 0.0)), written(1.0, (654321.0, 0.0, 0.0))
    assert [float(row[0]) for row in far] == pytest.approx([654321.0 + float(row[0]) for row in near], abs=1e-6)


def test_shafts_are_asked_for_their_roundness_and_long_ones_for_their_axis() -> None:
    def kinds(length: float) -> list[str]:
        text = suggested_plan(Mesh(*cylinder(diameter=8.0, height=length, segments=48)))
        return [row["kind"] for row in tomllib.loads(text)["characteristic"] if "cylinder" in row["name"]]

    assert kinds(10.0)[-1] == "roundness"
    assert kinds(30.0)[-1] == "straightness"
    # Quarters of a cylinder, as fillets are, are no shaft.
    text = suggested_plan(Mesh(*bracket()))
    assert sum(row["kind"] == "roundness" for row in tomllib.loads(text)["characteristic"]) == 1


def test_a_fillet_is_asked_for_its_profile_alone() -> None:
    mesh = Mesh(*bracket())
    rows = tomllib.loads(suggested_plan(mesh))["characteristic"]
    # The one between base and web is a quarter of a cylinder of 20 mm.
    arcs = {face.number for face in part_faces(mesh) if face.kind == "cylinder" and is_arc(mesh, face)}
    assert len(arcs) == 1
    assert {row["kind"] for row in rows if row["face"] in arcs} == {"profile"}
    round_faces = {face.number for face in part_faces(mesh) if face.kind == "cylinder"} - arcs
    assert {row["face"] for row in rows if row["kind"] == "diameter"} == round_faces


def test_the_unit_is_said_where_the_file_names_none() -> None:
    mesh = Mesh(*bracket())
    said = suggested_plan(mesh).splitlines()[0]
    assert said.startswith("# The part's file names no unit: lengths are its numbers, of which the part is 120 long")
    assert suggested_plan(mesh, units="mm").startswith("# Lengths are in mm, angles in degrees.\n")
    assert 'units = "mm"' in suggested_plan(mesh, units="mm").splitlines()
