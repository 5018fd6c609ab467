from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh
from dqreg.synth.parts import box, bracket


def cube(size: float = 1.0, at: float = 0.0, inward: bool = False) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = box((size, size, size))
    return vertices - vertices.mean(axis=0) + at, faces[:, ::-1] if inward else faces


def joined(*bodies: tuple[np.ndarray, np.ndarray]) -> Mesh:
    starts = np.cumsum([0, *(len(v) for v, _ in bodies[:-1])])
    faces = [f + start for (_, f), start in zip(bodies, starts, strict=True)]
    return Mesh(np.concatenate([v for v, _ in bodies]), np.concatenate(faces))


def test_a_sound_part_has_no_faults_and_the_volume_of_its_formula() -> None:
    mesh = Mesh(*box((3.0, 2.0, 1.0)))
    assert mesh.faults == ()
    assert (mesh.is_closed, mesh.is_consistently_wound, mesh.inward_bodies) == (True, True, (0, 1))
    assert mesh.volume == pytest.approx(6.0, rel=1e-14)
    far = Mesh(mesh.vertices + 1e6, mesh.faces)
    assert far.volume == pytest.approx(6.0, rel=1e-8)
    assert Mesh(*bracket()).faults == ()


def test_a_missing_face_is_three_open_sides() -> None:
    vertices, faces = bracket()
    mesh = Mesh(vertices, faces[1:])
    assert not mesh.is_closed
    assert mesh.is_consistently_wound
    assert mesh.faults == ("3 sides of faces are open: the mesh is not watertight",)


@pytest.mark.parametrize("flipped", [1, 3])
def test_flipped_faces_are_told_from_open_ones(flipped: int) -> None:
    vertices, faces = bracket()
    faces = faces.copy()
    faces[:flipped] = faces[:flipped, ::-1]
    mesh = Mesh(vertices, faces)
    assert mesh.is_closed
    assert not mesh.is_consistently_wound
    assert "wound against each other" in mesh.faults[0]


def test_an_inward_mesh_has_a_negative_volume_and_says_so() -> None:
    mesh = joined(cube(inward=True))
    assert mesh.volume == pytest.approx(-1.0)
    assert mesh.faults == ("1 of 1 bodies are wound inward",)


def test_a_cavity_is_wound_inward_rightly() -> None:
    mesh = joined(cube(3.0), cube(1.0, inward=True))
    assert mesh.faults == ()
    assert mesh.volume == pytest.approx(26.0)


def test_one_body_of_two_inside_out_is_found() -> None:
    assert joined(cube(), cube(at=5.0, inward=True)).faults == ("1 of 2 bodies are wound inward",)


def test_a_wall_standing_on_a_body_is_open() -> None:
    vertices, faces = cube()
    wall = np.vstack([vertices, [[0.0, 0.0, 9.0]]])
    assert not Mesh(wall, np.vstack([faces, [[faces[0, 0], faces[0, 1], len(vertices)]]])).is_closed


def test_two_cubes_that_touch_along_an_edge_are_closed_bodies() -> None:
    mesh = joined(cube(), (cube()[0] + [1.0, 1.0, 0.0], cube()[1]))
    assert mesh.is_closed
    assert mesh.is_consistently_wound
