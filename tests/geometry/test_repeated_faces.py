"""Faces that are there more than once: what is left is the mesh without them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dqreg import Target, prepare_target, register
from dqreg._arrays import IntArray
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection.deviations.measure import measure_deviations
from dqreg.synth.parts import box, bracket

VERTICES, FACES = bracket()
SOME = np.random.default_rng(63_001).choice(len(FACES), 7, replace=False)
# Neighbours: a patch has edges inside.
PATCH = np.flatnonzero((Mesh(VERTICES, FACES).face_normals @ [0.0, 0.0, 1.0]) > 0.9)

REPEATS: dict[str, Callable[[IntArray], IntArray]] = {
    "in the same sense": lambda rows: np.concatenate([FACES, np.roll(FACES[rows], 1, axis=1)]),
    "in the other sense": lambda rows: np.concatenate([FACES, FACES[rows][:, ::-1]]),
    "in the other sense before": lambda rows: np.concatenate([FACES[rows][:, ::-1], FACES]),
    "twice": lambda rows: np.concatenate([FACES, FACES[rows], FACES[rows]]),
    "all in the other sense": lambda rows: np.concatenate([FACES, FACES[:, ::-1]]),
}


@pytest.mark.parametrize("rows", [SOME, PATCH], ids=["apart", "beside each other"])
@pytest.mark.parametrize("how", REPEATS)
def test_what_is_left_is_the_mesh_without_repeats(how: str, rows: IntArray) -> None:
    faces = REPEATS[how](rows)
    mesh = Mesh(VERTICES, faces)
    assert (mesh.is_closed, mesh.is_consistently_wound, mesh._repeated) == (True, True, len(faces) - len(FACES))
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert mesh.faults == (f"{mesh._repeated} faces are there twice",)


def test_faces_of_bodies_that_touch_or_share_a_wall_stay_and_a_repeat_among_them_goes() -> None:
    (low, faces), (high, _) = box((1.0, 1.0, 1.0)), box((1.0, 1.0, 2.0))
    for other in (low + np.array([0.0, 0.0, 1.0]), high):
        both = np.concatenate([low, other]), np.concatenate([faces, faces + len(low)])
        assert len(Mesh(*both).faces) == 24
        side = int(np.argmax(Mesh(*both).face_normals[:, 0]))
        again = Mesh(both[0], np.concatenate([both[1], both[1][side : side + 1]]))
        assert (again._repeated, again.is_closed) == (1, True)


def test_an_open_surface_with_a_repeat_stays_open_and_a_sheet_in_both_senses_stays_what_it_is() -> None:
    mesh = Mesh(VERTICES, np.concatenate([FACES[3:], FACES[10:12]]))
    assert mesh.topology.open_sides == Mesh(VERTICES, FACES[3:]).topology.open_sides > 0
    sheet = Mesh(VERTICES, np.concatenate([FACES[3:], FACES[3:, ::-1]]))
    assert (sheet.is_closed, sheet._repeated) == (True, 0)


def test_deviations_have_their_signs_and_the_verdict_says_so_once(tmp_path: Path) -> None:
    part = Mesh(VERTICES, FACES)
    again = Mesh(VERTICES, np.concatenate([FACES, FACES[SOME[:4]], FACES[SOME[4:], ::-1]]))
    scan = part.corners.mean(axis=1) + 0.01 * part.face_normals
    one, other = (measure_deviations(scan, mesh, MeshSurface(mesh)) for mesh in (part, again))
    np.testing.assert_array_equal(other.values, one.values)
    assert other.values.min() > 0.0
    target = prepare_target(again)
    target.save(tmp_path / "part.npz")
    clean = register(scan, part, "identity", effort="fast")
    for made in (target, Target.load(tmp_path / "part.npz")):
        found = register(scan, made, "identity", effort="fast")
        np.testing.assert_array_equal(found.T_target_source, clean.T_target_source)
        assert (found.verdict.level, found.verdict.codes) == (
            clean.verdict.level,
            (*clean.verdict.codes, "repeated_faces"),
        )
