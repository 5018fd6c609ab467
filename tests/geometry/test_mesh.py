from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.synth.parts import box, bracket

NAN, INF = float("nan"), float("inf")
CORNERS = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (CORNERS, [], "the mesh has no faces"),
        (CORNERS, np.zeros((0, 3), dtype=int), "the mesh has no faces"),
        (CORNERS, [[0, 1, 3]], r"faces refer to vertices 0\.\.3, but there are 3"),
        (CORNERS, [[-1, 0, 1]], r"faces refer to vertices -1\.\.1"),
        (CORNERS, [[0.0, 1.0, 2.0]], "faces must be integers"),
        (CORNERS, [0, 1, 2], r"of shape \(f, 3\)"),
        (CORNERS, [[0, 1, 2, 0]], r"of shape \(f, 3\)"),
        ([[0.0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "vertices must have shape"),
        ([[NAN, 0, 0], *CORNERS[1:]], [[0, 1, 2]], "uses a vertex that is NaN or infinite"),
        ([[INF, 0, 0], *CORNERS[1:]], [[0, 1, 2]], "uses a vertex that is NaN or infinite"),
        (CORNERS, [[0, 1, 1], [2, 2, 2]], "2 faces, none with an area"),
        ([[0.0, 0, 0], [1, 1, 1], [3, 3, 3]], [[0, 1, 2]], "1 faces, none with an area"),
        (np.zeros((3, 3)), [[0, 1, 2]], "none with an area"),
    ],
)
def test_what_is_no_mesh_is_refused_in_words(vertices: Any, faces: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Mesh(vertices, faces)


def test_faces_without_area_are_left_out_and_counted() -> None:
    mesh = Mesh([*CORNERS, [2.0, 0, 0]], [[0, 0, 1], [0, 1, 2], [0, 1, 3], [1, 3, 2]], dropped=5)
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert mesh.dropped == 7


def test_vertices_that_no_face_uses_may_be_anything_and_count_for_nothing() -> None:
    mesh = Mesh([*CORNERS, [NAN, 0, 0], [1e9, 0, 0]], [[0, 1, 2]])
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
    assert mesh.centre.tolist() == [0.5, 0.5, 0.0]
    assert mesh.diagonal == np.sqrt(2.0)


@pytest.mark.parametrize(("scale", "origin"), [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 5e6)])
def test_a_box_at_any_size_and_place_has_its_own_areas_and_normals(scale: float, origin: float) -> None:
    vertices, faces = box((3.0, 2.0, 1.0))
    mesh = Mesh(vertices * scale + origin, faces)
    assert (len(mesh.faces), mesh.dropped) == (12, 0)
    # Corners at the far origin are rounded to 1e-9.
    assert mesh.face_areas.sum() == pytest.approx(22.0 * scale**2, rel=1e-8 if origin else 1e-13)
    np.testing.assert_allclose(mesh.face_areas @ mesh.face_normals, 0.0, atol=1e-8 * scale**2)
    outwards = np.einsum("fi,fi->f", mesh.corners.mean(axis=1) - mesh.centre, mesh.face_normals)
    np.testing.assert_allclose(np.sort(outwards / scale), np.repeat([0.5, 1.0, 1.5], 4), atol=1e-8)


def test_volume_by_the_divergence_theorem_needs_every_corner_and_normal_right() -> None:
    mesh = Mesh(*bracket())
    flux = np.einsum("f,fi,fi->", mesh.face_areas, mesh.face_normals, mesh.corners.mean(axis=1)) / 3.0
    shifted = Mesh(mesh.vertices + np.array([100.0, -50.0, 7.0]), mesh.faces)
    again = np.einsum("f,fi,fi->", shifted.face_areas, shifted.face_normals, shifted.corners.mean(axis=1)) / 3.0
    assert 0.0 < flux < np.prod(np.ptp(mesh.vertices, axis=0))
    assert again == pytest.approx(flux, rel=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.uint32, np.uint64])
def test_indices_of_any_integer_type(dtype: Any) -> None:
    faces = np.array([[0, 1, 2]], dtype=dtype)
    mesh = Mesh(CORNERS, faces)
    assert mesh.faces.dtype == np.int64
    assert mesh.faces.tolist() == [[0, 1, 2]]


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


def test_faces_of_the_part_are_found_once_and_nobody_changes_them() -> None:
    mesh = Mesh(*bracket())
    count, labels = faces_of(mesh)
    assert faces_of(mesh)[1] is labels
    assert not labels.flags.writeable
    # Those of another mesh, and of the same one elsewhere, are its own.
    moved = faces_of(Mesh(mesh.vertices + 1.0, mesh.faces))
    assert (moved[0], moved[1].tolist()) == (count, labels.tolist())
    assert moved[1] is not labels
