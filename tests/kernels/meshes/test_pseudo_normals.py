from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.meshes.pseudo_normals import add_scaled_rows, corner_angles, pseudo_normals_at

ON_FACE = 1e-6


def plain_kinds(points: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What of its triangle is closest to each point: 0 the face, 1 a side, 2 a corner; and which of the three."""
    sides = np.roll(corners, -1, axis=1) - corners
    offsets = points[:, None, :] - corners
    inside = (np.einsum("nki,nki->nk", np.cross(normals[:, None, :], sides), offsets) >= 0.0).all(axis=1)
    along = np.einsum("nki,nki->nk", offsets, sides) / np.einsum("nki,nki->nk", sides, sides)
    clipped = np.clip(along, 0.0, 1.0)
    side = np.linalg.norm(offsets - clipped[:, :, None] * sides, axis=2).argmin(axis=1)
    share = clipped[np.arange(len(points)), side]
    at_end = (share == 0.0) | (share == 1.0)
    return np.where(inside, 0, np.where(at_end, 2, 1)), np.where(share == 1.0, (side + 1) % 3, side)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_the_pseudo_normal_is_that_of_the_nearest_feature(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, points = rng.normal(size=(40, 3, 3)), 2.0 * rng.normal(size=(200, 3))
    faces = rng.integers(40, size=200)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True))[faces]
    sides, welded, vertices = rng.normal(size=(40, 3, 3)), rng.integers(70, size=(40, 3)), rng.normal(size=(70, 3))
    kind, which = plain_kinds(points, corners[faces], normals)
    expected = normals.copy()
    expected[kind == 1] = sides[faces, which][kind == 1]
    expected[kind == 2] = vertices[welded[faces, which]][kind == 2]
    # Feet on the rim are asked what they are closest to; in the middle of a face nothing is asked.
    at = [corners[faces, 0], corners[faces].mean(axis=1)]
    for feet, wanted in zip(at, (expected, normals), strict=True):
        found, values = normals.copy(), np.ones(200)
        for first in range(0, 200, 70):
            last = min(first + 70, 200)
            given = points, feet, faces, corners, sides, welded, vertices, ON_FACE, -1.0
            pseudo_normals_at(first, last, *given, found, values)
        np.testing.assert_array_equal(found, wanted)
        above = np.einsum("ni,ni->n", points - feet, wanted)
        clear = np.abs(above) > 1e-12
        np.testing.assert_array_equal((values < 0.0)[clear], (above > 0.0)[clear])


def test_angles_and_sums_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    corners, angles = rng.normal(size=(50, 3, 3)), np.zeros((50, 3))
    corner_angles(0, 50, corners, angles)
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    np.testing.assert_allclose(np.cos(angles), np.einsum("fki,fki->fk", ahead, back) / lengths, rtol=0, atol=1e-12)
    np.testing.assert_allclose(angles.sum(axis=1), np.pi, rtol=1e-12)
    rows, places, sums, expected = rng.normal(size=(50, 3)), rng.integers(20, size=150), np.zeros((20, 3)), None
    add_scaled_rows(rows, 3, angles.ravel(), places, sums)
    expected = np.zeros((20, 3))
    np.add.at(expected, places, np.repeat(rows, 3, axis=0) * angles.reshape(-1, 1))
    np.testing.assert_array_equal(sums, expected)
