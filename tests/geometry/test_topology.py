from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import Mesh
from dqreg.geometry.topology import NORMAL_ROUNDING, SMOOTH_DEG
from dqreg.kernels import threads
from dqreg.kernels.meshes.face_fans import MANY
from dqreg.synth.parts import bracket, cylinder


def crowded(seed: int, count: int, places: int, jitter: float = 0.0) -> Mesh:
    """Triangles over few places, each place several vertices that differ by rounding; some are copies of others."""
    rng = np.random.default_rng(seed)
    vertices = np.repeat(rng.integers(0, 3, (places, 3)).astype(float), 2, axis=0)
    # A box about all of known size, whose rounding to the grid is not on the edge between two nodes.
    vertices = np.concatenate(
        [vertices + jitter * rng.uniform(-1, 1, vertices.shape), [[-7.0, -7, -7], [9, 9, 9], [9, 0, 0]]]
    )
    faces = np.concatenate([rng.integers(0, 2 * places, (count, 3)), [2 * places + np.arange(3)]])
    return Mesh(vertices, faces)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(3, 12), st.sampled_from([0.0, 1e-9]), st.booleans())
def test_neighbours_and_closedness_are_those_of_the_topology(
    seed: int, count: int, places: int, jitter: float, twice: bool
) -> None:
    mesh = crowded(seed, count, places, jitter)
    if twice:
        # Each edge is met an even number of times.
        mesh = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))
        assert mesh.is_closed
    fans, every = mesh._fans.find(np.arange(len(mesh.faces))), np.arange(len(mesh.faces))
    np.testing.assert_array_equal(fans.neighbours, mesh.face_neighbours)
    turns = np.einsum("fa,fka->fk", mesh.face_normals, mesh.face_normals[mesh.face_neighbours])
    turns[mesh.face_neighbours == every[:, None]] = 2.0
    np.testing.assert_allclose(fans.turns, turns, atol=1e-15)
    assert mesh.is_closed == (mesh.topology.open_sides == 0)


@pytest.mark.parametrize("make", [bracket, cylinder])
def test_a_part_is_closed_and_is_not_without_any_of_its_faces(make) -> None:
    vertices, faces = make()
    assert Mesh(vertices, faces).is_closed
    for f in np.linspace(0, len(faces) - 1, 20).astype(int):
        assert not Mesh(vertices, np.delete(faces, f, axis=0)).is_closed


def test_vertices_that_are_not_shared_and_faces_without_area_make_no_difference() -> None:
    part = Mesh(*bracket())
    soup = Mesh(part.corners.reshape(-1, 3), np.arange(3 * len(part.faces)).reshape(-1, 3))
    assert soup.is_closed
    rows = np.arange(len(part.faces))
    one, other = part._fans.find(rows), soup._fans.find(rows)
    np.testing.assert_array_equal(one.neighbours, other.neighbours)
    np.testing.assert_array_equal(one.is_round, other.is_round)
    np.testing.assert_array_equal(one.corner_normals, other.corner_normals)
    # A side that three corners in line close.
    flat = Mesh(
        [[0.0, 0, 0], [2, 0, 0], [1, 1, 0], [1, 0, 0], [1, -1, 0]], [[0, 1, 2], [1, 0, 4], [0, 3, 1], [0, 3, 1]]
    )
    assert flat.is_closed == (flat.topology.open_sides == 0)
    assert len(flat.flat) == 2


def test_a_face_two_of_whose_corners_are_one_place_opens_nothing() -> None:
    part = Mesh(*bracket())
    beside = part.vertices[0] + 1e-10 * part.diagonal
    more = np.concatenate([part.faces, [[0, 5, len(part.vertices)]]])
    mesh = Mesh(np.concatenate([part.vertices, beside[None]]), more)
    assert len(mesh.faces) == len(more)
    assert mesh.topology.open_sides == 0
    assert mesh.is_closed


def angle(corners: np.ndarray, k: int) -> float:
    one, two = corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]
    return float(np.arccos(np.clip(one @ two / np.linalg.norm(one) / np.linalg.norm(two), -1.0, 1.0)))


def corner_normal(mesh: Mesh, f: int, k: int) -> np.ndarray:
    """The oracle: from face to face over the sides at a vertex, as long as these are smooth."""
    vertex = mesh.faces[f, k]
    around = [g for g in range(len(mesh.faces)) if vertex in mesh.faces[g]]
    joined, waiting = {f}, deque([f])
    while waiting:
        g = waiting.popleft()
        for h in around:
            smooth = mesh.face_normals[g] @ mesh.face_normals[h] >= np.cos(np.deg2rad(SMOOTH_DEG))
            if h not in joined and smooth and len(set(mesh.faces[g]) & set(mesh.faces[h])) == 2:
                joined.add(h)
                waiting.append(h)
    angles = {g: angle(mesh.corners[g], list(mesh.faces[g]).index(vertex)) for g in joined}
    total = sum(angles[g] * mesh.face_normals[g] for g in joined)
    return total / np.linalg.norm(total)


@pytest.mark.parametrize("segments", [8, 16, pytest.param(20, marks=pytest.mark.soak)])
def test_corners_have_the_mean_normal_of_what_smooth_sides_join_there(segments: int) -> None:
    vertices, faces = bracket(segments=segments)
    # Nothing is smooth in an octagon; the place of each vertex off it makes all sides different.
    mesh = Mesh(vertices * (1.0 + 0.02 * np.random.default_rng(0).uniform(size=(len(vertices), 1))), faces)
    rows = np.arange(0, len(mesh.faces), 5)
    fans = mesh._fans.find(rows)
    expected = np.array([[corner_normal(mesh, f, k) for k in range(3)] for f in rows])
    is_round = np.abs(expected - mesh.face_normals[rows, None]).reshape(-1, 9).max(axis=1) > NORMAL_ROUNDING
    np.testing.assert_array_equal(fans.is_round[rows], is_round)
    assert is_round.any()
    np.testing.assert_allclose(fans.corner_normals[rows][is_round], expected[is_round], atol=1e-12)


def test_a_sharp_edge_stays_sharp_where_roundings_lead_around_its_end() -> None:
    # A fold that flattens out: both sides are joined at its end, and at its sharp end they are not.
    x, lean = np.linspace(0.0, 20.0, 21), np.linspace(1.2, 0.0, 21)
    ridge, left, right = (
        np.stack([x, y, z], axis=1) for y, z in ((0 * x, 0 * x), (-1 + 0 * x, -lean), (1 + 0 * x, -lean))
    )
    k = np.arange(20)
    one = np.concatenate([np.stack([k, k + 1, k + 22], 1), np.stack([k, k + 22, k + 21], 1)])
    two = np.concatenate([np.stack([k, k + 43, k + 1], 1), np.stack([k, k + 42, k + 43], 1)])
    mesh = Mesh(np.concatenate([ridge, left, right]), np.concatenate([one[:, ::-1], two[:, ::-1]]))
    rows = np.flatnonzero(mesh.corners[:, :, 0].max(axis=1) < 6.0)
    normals = mesh._fans.find(rows).corner_normals[rows]
    is_round = mesh._fans.is_round[rows]
    assert is_round.any()
    assert (np.einsum("fki,fi->fk", normals[is_round], mesh.face_normals[rows][is_round]) > np.cos(0.2)).all()


def test_the_hub_of_a_great_many_needles_has_the_normals_of_its_faces_and_takes_no_long() -> None:
    count = 200_000
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rim = np.arange(1, count + 1)
    vertices = np.concatenate([[[0.0, 0, 0.3]], np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])])
    mesh = Mesh(vertices, np.stack([0 * rim, rim, np.roll(rim, -1)], axis=1))
    fans = mesh._fans.find(np.arange(count))
    np.testing.assert_array_equal(fans.neighbours, mesh.face_neighbours)
    np.testing.assert_allclose(fans.corner_normals[:, 0], mesh.face_normals, atol=1e-12)
    assert count > MANY


@pytest.mark.parametrize("count", [1, 3])
def test_what_is_found_does_not_depend_on_what_was_asked_before_or_on_threads(
    monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    vertices, faces = bracket(segments=64)
    every = np.arange(len(faces))
    whole = Mesh(vertices, faces)._fans.find(every)
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    bit_by_bit = Mesh(vertices, faces)._fans
    for rows in (every[::7], np.array([-1, 3, 3]), every[::-1], every):
        bit_by_bit.find(rows)
    for name in ("neighbours", "corner_normals", "is_round"):
        np.testing.assert_array_equal(getattr(bit_by_bit, name), getattr(whole, name))
