from __future__ import annotations

import numpy as np

from dqreg.kernels.search.coarse_to_fine_nearest import nearest_at_corners, nearest_from_coarser, planes_at_nodes

SHAPE = np.array([6, 7, 9])
COARSE = SHAPE // 2 + 1


def nodes_of(shape: np.ndarray) -> np.ndarray:
    return np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)


def nothing() -> tuple[np.ndarray, np.ndarray]:
    return np.full(np.prod(SHAPE), -1, dtype=np.int32), np.full(np.prod(SHAPE), np.inf, dtype=np.float32)


def test_corners_hold_the_nearest_of_the_points_in_their_cells() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, SHAPE - 1.0, size=(60, 3))
    # On the last slab there is no cell beyond.
    points[0] = SHAPE - 1.0
    held, squares = nothing()
    nearest_at_corners(points, SHAPE, held, squares)
    apart = nodes_of(SHAPE)[:, None] - np.floor(points)
    beside = ((apart == 0.0) | (apart == 1.0)).all(axis=2)
    away = np.where(beside, np.linalg.norm(nodes_of(SHAPE)[:, None] - points, axis=2), np.inf)
    assert 0 < beside.any(axis=1).sum() < len(held)
    np.testing.assert_array_equal(held, np.where(beside.any(axis=1), away.argmin(axis=1), -1))
    np.testing.assert_allclose(np.sqrt(squares), away.min(axis=1), rtol=1e-6)


def test_nodes_hold_the_nearest_of_what_the_coarser_ones_around_them_do() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, SHAPE - 1.0, size=(40, 3))
    known = rng.integers(0, 40, size=np.prod(COARSE)).astype(np.int32)
    held, squares = nothing()
    held[:50], squares[:50] = 3, 0.5
    for first, last in ((3, 6), (0, 3)):
        nearest_from_coarser(first, last, points, SHAPE, COARSE, known, held, squares)
    for n, node in enumerate(nodes_of(SHAPE)):
        around = np.abs(nodes_of(COARSE) - node / 2.0).max(axis=1) <= 0.5
        rows = known[around]
        away = np.linalg.norm(points[rows] - node, axis=1)
        if n < 50 and away.min() ** 2 >= 0.5:
            assert (held[n], squares[n]) == (3, 0.5)
        else:
            assert held[n] in rows
            np.testing.assert_allclose(np.sqrt(squares[n]), away.min(), rtol=1e-6)


def test_planes_are_those_of_what_is_held() -> None:
    rng = np.random.default_rng(2)
    places, normals = rng.normal(size=(2, 5, 3))
    held, planes = rng.integers(0, 5, size=8).astype(np.int32), np.zeros((9, 6), dtype=np.float32)
    for first, last in ((0, 3), (3, 8)):
        planes_at_nodes(first, last, held, places, normals, planes)
    np.testing.assert_array_equal(planes[:8], np.hstack([places[held], normals[held]]).astype(np.float32))
    assert (planes[8] == 0.0).all()
