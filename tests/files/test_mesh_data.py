from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dqreg.errors import InputError
from dqreg.files.mesh_data import make_mesh, merge_identical

FEW = st.sampled_from([0.0, -0.0, 1.0, 0.5, -1.0, 1e-6])
# As CAD programs write one and the same corner: zero, or what cancelling left of it.
ROUNDING = st.sampled_from([0.0, -1e-17, 3e-16, 1e-300])


@settings(deadline=None, max_examples=100)
@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=FEW))
def test_merging_agrees_with_a_dictionary(vertices: np.ndarray) -> None:
    distinct, place = merge_identical(vertices)
    seen: dict[tuple[float, ...], int] = {}
    expected = [seen.setdefault(tuple(row), len(seen)) for row in vertices.tolist()]
    assert place.tolist() == expected
    np.testing.assert_array_equal(distinct, [list(row) for row in seen])


@settings(deadline=None, max_examples=100)
@given(st.data(), hnp.arrays(np.float64, st.tuples(st.integers(2, 20), st.just(3)), elements=FEW), st.floats(1e-9, 1e9))
def test_rounding_does_not_part_vertices_in_any_unit(data: st.DataObject, vertices: np.ndarray, scale: float) -> None:
    vertices[:2] = [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]
    rounded = vertices + data.draw(hnp.arrays(np.float64, vertices.shape, elements=ROUNDING))
    expected = merge_identical(vertices)[1]
    both = merge_identical(np.concatenate([vertices, rounded]) * scale)
    assert both[1].tolist() == [*expected, *expected]
    assert len(both[0]) == expected.max() + 1


@settings(deadline=None, max_examples=50)
@given(
    hnp.arrays(np.float64, (6, 3), elements=FEW),
    hnp.arrays(np.int64, st.tuples(st.integers(1, 9), st.just(3)), elements=st.integers(0, 5)),
)
def test_each_triangle_stays_where_it_was(vertices: np.ndarray, faces: np.ndarray) -> None:
    given_vertices, given_faces = vertices.copy(), faces.copy()
    mesh = make_mesh(Path("a.stl"), vertices, faces)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], given_vertices[given_faces])
    np.testing.assert_array_equal(vertices, given_vertices)
    np.testing.assert_array_equal(faces, given_faces)
    assert sorted(set(mesh.faces.ravel().tolist())) == list(range(len(mesh.vertices)))


def test_neighbours_that_float32_tells_apart_stay_apart() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nextafter(np.float32(1), np.float32(2)), 0, 0]])
    assert len(make_mesh(Path("a.stl"), vertices, np.array([[0, 1, 2], [3, 1, 2]])).vertices) == 4


@pytest.mark.parametrize("vertices", [np.full((3, 3), 7.0), np.array([[-1e308] * 3, [1e308] * 3, [1e308] * 3])])
def test_a_size_without_a_grid_merges_equal_numbers(vertices: np.ndarray) -> None:
    distinct, place = merge_identical(vertices)
    np.testing.assert_array_equal(distinct[place], vertices)
    assert len(distinct) == len(np.unique(vertices, axis=0))


def test_an_unused_vertex_may_be_anything() -> None:
    vertices = np.array([[np.nan, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = make_mesh(Path("a.obj"), vertices, np.array([[1, 2, 3]]))
    assert mesh.vertices.tolist() == vertices[1:].tolist()


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.eye(3), np.zeros((0, 3), dtype=int), "3 vertices and no faces"),
        (np.eye(3), [[0, 1, 3]], "names vertex 3; expected indices from 0 to 2"),
        (np.eye(3), [[0, -1, 2]], "names vertex -1"),
        (np.zeros((0, 3)), [[0, 0, 0]], "names vertex 0; expected vertices"),
        (np.array([[np.inf, 0, 0]]), [[0, 0, 0]], "1 vertices of faces that are NaN or infinite"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices: np.ndarray, faces: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_mesh(Path("a.stl"), vertices, np.asarray(faces))
