from __future__ import annotations

import itertools
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import Mesh
from dqreg.kernels.meshes.areas_by_direction import areas_by_direction
from dqreg.kernels.meshes.mesh_faces import ENDS, MOMENTS, face_columns, solid_faces, surface_moments
from dqreg.kernels.meshes.mesh_sides import number_sides
from dqreg.synth.parts import bracket


def random_faces(seed: int, faces: int, vertices: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, vertices, (faces, 3))


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 8), st.integers(0, 5))
def test_sides_meet_as_in_a_dictionary_of_edges(seed: int, count: int, vertices: int, flat: int) -> None:
    corners = random_faces(seed, count + flat, vertices)
    real = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    edges, across, neighbours = np.zeros_like(corners), np.zeros_like(corners), np.zeros((count, 3), dtype=np.int64)
    number_sides(corners, vertices, real, edges, across, neighbours)
    ends = [tuple(sorted((row[k], row[(k + 1) % 3]))) for row in corners.tolist() for k in range(3)]
    numbers = {pair: number for number, pair in enumerate(sorted(set(ends)))}
    assert edges.ravel().tolist() == [numbers[pair] for pair in ends]
    sides = defaultdict(list)
    for side, pair in enumerate(ends):
        if real[side // 3]:
            sides[pair].append(side)
    expected = np.arange(len(ends))
    for met in sides.values():
        for one, other in itertools.pairwise(met):
            expected[other] = one
        if len(met) > 1:
            expected[met[0]] = met[1]
    np.testing.assert_array_equal(across.ravel(), expected)
    others = expected.reshape(-1, 3)[:count] // 3
    np.testing.assert_array_equal(neighbours, np.where(others < count, others, np.arange(count)[:, None]))


def test_a_fan_of_many_faces_takes_no_longer_than_as_many_others() -> None:
    # Sides are sorted by counting: were they compared at their vertex, 10^11 comparisons would be made here.
    rim = np.arange(1, 400_001)
    corners = np.stack([np.zeros_like(rim), rim, np.roll(rim, -1)], axis=1)
    edges, across, neighbours = (np.zeros_like(corners) for _ in range(3))
    number_sides(corners, len(rim) + 1, np.ones(len(rim), dtype=bool), edges, across, neighbours)
    np.testing.assert_array_equal(neighbours[:, 0], np.roll(np.arange(len(rim)), 1))
    np.testing.assert_array_equal(neighbours[:, 2], np.roll(np.arange(len(rim)), -1))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1, 7]))
def test_areas_are_those_of_equal_directions(seed: int, count: int, parts: int) -> None:
    rng = np.random.default_rng(seed)
    normals, areas = rng.normal(size=(count, 3)), rng.uniform(size=count)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    codes, sums = np.zeros(64, dtype=np.int64), np.zeros(64)
    areas_by_direction(normals, areas, parts, codes, sums)
    directions, rows = np.unique((normals * parts).round(), axis=0, return_inverse=True)
    base = 2 * parts + 1
    expected = (directions.astype(int) + parts) @ np.array([base**2, base, 1]) + 1
    used = np.flatnonzero(codes)
    np.testing.assert_array_equal(np.sort(codes[used]), expected)
    np.testing.assert_array_equal(sums[used][np.argsort(codes[used])], np.bincount(rows.ravel(), areas))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6), st.sampled_from([0.0, 1e7]))
def test_columns_and_ends_are_those_of_numpy(seed: int, scale: float, far: float) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = scale * (rng.normal(size=(12, 3)) + far), random_faces(seed, 40, 12)
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    longest = np.ptp(corners, axis=1).max(axis=1)
    eps = float(np.finfo(float).eps)
    solid, ends = np.zeros(40, dtype=bool), np.zeros((4, ENDS))
    for first in range(0, 40, 10):
        solid_faces(first, first + 10, vertices, faces, 10, eps, solid, ends)
    np.testing.assert_array_equal(
        solid, lengths > eps * longest * np.maximum(longest, np.abs(corners).max(axis=(1, 2)))
    )
    np.testing.assert_array_equal(ends[:, :3].min(axis=0), corners.min(axis=(0, 1)))
    np.testing.assert_array_equal(ends[:, 3:6].max(axis=0), corners.max(axis=(0, 1)))
    normals, areas = np.zeros((40, 3)), np.zeros(40)
    face_columns(0, 40, vertices, faces, normals, areas)
    np.testing.assert_allclose(areas, 0.5 * lengths, rtol=1e-12)
    np.testing.assert_allclose(normals[solid], across[solid] / lengths[solid, None], atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("corner", range(3))
def test_a_corner_that_is_not_finite_is_seen(value: float, corner: int) -> None:
    vertices, ends = np.eye(3), np.zeros((1, ENDS))
    vertices[corner, 2 - corner] = value
    solid_faces(0, 1, vertices, np.array([[0, 1, 2]]), 1, 1e-16, np.zeros(1, dtype=bool), ends)
    assert ends[0, 6] == 1.0


@pytest.mark.parametrize("far", [0.0, 1e6])
def test_moments_are_those_of_many_points_of_the_surface(far: float) -> None:
    # Oracle: each triangle by the six-point rule of degree four, which is exact for squares; its own place far away.
    mesh = Mesh(*bracket())
    at, share = (0.445948490915965, 0.091576213509771), (0.223381589678011, 0.109951743655322)
    rows, weights = [], []
    for place, weight in zip(at, share, strict=True):
        for k in range(3):
            shares = np.full(3, place)
            shares[k] = 1.0 - 2.0 * place
            rows.append(np.einsum("k,fki->fi", shares, mesh.corners))
            weights.append(weight * mesh.face_areas)
    points, areas = np.concatenate(rows), np.concatenate(weights)
    mean = areas @ points / areas.sum()
    covariance = (points - mean).T @ ((points - mean) * areas[:, None]) / areas.sum()
    found = Mesh(mesh.vertices + far, mesh.faces)._moments
    size = mesh.diagonal
    # Coordinates of 1e6 keep ten digits of the part.
    np.testing.assert_allclose(found[0] - far, mean, atol=(1e-12 if far == 0.0 else 1e-9) * max(size, 1.0))
    np.testing.assert_allclose(found[1], covariance, atol=(1e-12 if far == 0.0 else 1e-8) * size**2)


def test_moments_are_the_same_sums_for_any_ranges() -> None:
    mesh = Mesh(*bracket())
    sums = np.zeros((len(mesh.faces), MOMENTS))
    for f in range(len(mesh.faces)):
        surface_moments(f, f + 1, mesh.corners, mesh.face_areas, mesh.centre, 1, sums)
    whole = np.zeros((1, MOMENTS))
    surface_moments(0, len(mesh.faces), mesh.corners, mesh.face_areas, mesh.centre, len(mesh.faces), whole)
    np.testing.assert_allclose(sums.sum(axis=0), whole[0], rtol=1e-12, atol=1e-9 * np.abs(whole).max())
