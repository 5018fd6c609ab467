"""Datums as one would choose them: a stable seat, perpendicular sides or holes, and all six motions held."""

from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh
from dqreg.inspection import part_faces
from dqreg.inspection.plan.suggested_datums import SuggestedDatum, suggest_datums
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box, bracket, cylinder, flange


def chosen(mesh: Mesh, covered: dict[int, float] | None = None) -> tuple[SuggestedDatum, ...]:
    return suggest_datums(mesh, part_faces(mesh), covered)


def test_a_bracket_stands_on_its_base() -> None:
    mesh = Mesh(*bracket())
    a, b, c = chosen(mesh)
    axes = [each.face.feature.axis for each in (a, b, c) if each.face.feature]
    # The underside: the wall is nearly as large, but the part has pads on one side of it and would tip.
    np.testing.assert_allclose(axes[0], [0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(np.abs(np.array(axes) @ np.array(axes).T), np.eye(3), atol=1e-6)
    assert "stands on it" in a.reason


def test_the_choice_turns_with_the_part_and_knows_what_was_scanned() -> None:
    vertices, faces = bracket()
    mesh = Mesh(vertices, faces)
    turned = Mesh(pose.apply(twist.exp([0.4, 0.3, -0.8, 5, 6, 7]), vertices), faces)
    numbers = [each.face.number for each in chosen(mesh)]
    assert [each.face.number for each in chosen(turned)] == numbers
    covered = {face.number: 1.0 for face in part_faces(mesh)} | {numbers[0]: 0.0}
    assert numbers[0] not in [each.face.number for each in chosen(mesh, covered)]


def test_holes_hold_what_no_side_does() -> None:
    # A round flange with bolt holes: no side is flat, and a hole beside the axis holds the rotation about it.
    a, b, c = chosen(Mesh(*flange(segments=32)))
    assert a.face.kind == "plane"
    assert b.face.kind == c.face.kind == "cylinder"
    assert c.face.is_hole
    assert b.face.feature is not None
    assert c.face.feature is not None
    assert np.linalg.norm(np.cross(c.face.feature.point - b.face.feature.point, b.face.feature.axis)) > 10.0


def test_a_round_part_has_none() -> None:
    assert chosen(Mesh(*cylinder(diameter=20.0, height=30.0, segments=48))) == ()
    assert len(chosen(Mesh(*box((3.0, 2.0, 1.0))))) == 3
