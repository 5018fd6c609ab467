from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.steps.points_on_faces import points_on_faces
from dqreg.rigid import twist

INSIDE, OFF, THICK, SPREAD = 0.05, 0.03, 0.02, 0.015
PARTS = 3


def plain(
    points: np.ndarray, corners: np.ndarray, normals: np.ndarray, T: np.ndarray, parts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same run by run, from distances to the lines through the sides."""
    shape = len(points), PARTS
    on, means, within = np.zeros(points.shape[:2], dtype=bool), np.zeros((*shape, 3)), np.zeros(shape)
    for r, run in enumerate(points):
        moved = run @ T[:3, :3].T + T[:3, 3]
        heights = (moved - corners[r, 0]) @ normals[r]
        insets = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            inward = np.cross(normals[r], corners[r, b] - corners[r, a])
            insets.append((moved - corners[r, a]) @ (inward / np.linalg.norm(inward)))
        lies = (np.min(insets, axis=0) > INSIDE) & (np.abs(heights) <= OFF)
        if lies.any() and np.mean(heights[lies] ** 2) > THICK**2 and np.var(heights[lies]) > SPREAD**2:
            continue
        on[r] = lies
        for part in np.unique(parts[r][lies]):
            own = lies & (parts[r] == part)
            means[r, part], within[r, part] = run[own].mean(axis=0), np.sum((heights[own] - heights[own].mean()) ** 2)
    return on, means, within


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.sampled_from([1e-3, 0.02, 0.1]))
def test_points_are_on_their_face_as_one_by_one(seed: int, length: int, scatter: float) -> None:
    rng = np.random.default_rng(seed)
    runs, corners = 5, rng.normal(size=(5, 3, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    T = twist.exp(rng.normal(size=6))
    shares = rng.dirichlet(np.ones(3), size=(runs, length))
    placed = (
        np.einsum("rlk,rki->rli", shares, corners) + scatter * rng.normal(size=(runs, length, 1)) * normals[:, None]
    )
    points = (placed - T[:3, 3]) @ T[:3, :3]
    parts = rng.integers(0, PARTS, size=(runs, length)).astype(np.uint8)
    on, counts = np.zeros((runs, length), dtype=bool), np.zeros((runs, PARTS), dtype=np.int64)
    means, within = np.zeros((runs, PARTS, 3)), np.zeros((runs, PARTS))
    for first, last in ((0, 2), (2, runs)):
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        limits, faces, found = (INSIDE, OFF, THICK, SPREAD, parts.ravel()), np.arange(runs), (on, counts, means, within)
        points_on_faces(first, last, flat, length, corners, faces, normals, T, *limits, *found)
    expected = plain(points, corners, normals, T, parts)
    np.testing.assert_array_equal(on, expected[0])
    for part in range(PARTS):
        np.testing.assert_array_equal(counts[:, part], (on & (parts == part)).sum(axis=1))
    some = counts > 0
    np.testing.assert_allclose(means[some], expected[1][some], atol=1e-12)
    np.testing.assert_allclose(within[some], expected[2][some], atol=1e-12)
