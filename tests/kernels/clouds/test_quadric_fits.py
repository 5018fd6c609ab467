from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.clouds.quadric_fits import RIDGE, quadric_residual_rows, solve

LEAST = 0.3


def residuals_of(points: FloatArray, neighbours: IntArray, normals: FloatArray) -> FloatArray:
    found = np.zeros(len(neighbours))
    quadric_residual_rows(0, len(neighbours), points, neighbours, normals, LEAST, found)
    return found


def plain(neighbours: FloatArray, normal: FloatArray) -> float:
    """The plain twin: NumPy's singular values for the frame, its least squares for the quadric."""
    away = neighbours - neighbours.mean(axis=0)
    across = np.linalg.svd(normal[None])[2][1:]
    u, v = across @ away.T
    spreads = np.linalg.eigvalsh(np.stack([u, v]) @ np.stack([u, v]).T)
    if not spreads[0] > LEAST**2 * spreads[1]:
        return np.nan
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    heights = away @ normal
    left = heights - terms @ np.linalg.lstsq(terms, heights, rcond=None)[0]
    return float(np.sqrt(left @ left / (len(left) - 6)))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 1.0, 50.0]), st.sampled_from([0.2, 0.5, 1.0]))
def test_what_is_left_is_that_of_least_squares(seed: int, size: float, thin: float) -> None:
    rng = np.random.default_rng(seed)
    points = size * rng.normal(size=(40, 3)) * [1.0, thin, 0.1]
    neighbours = np.stack([rng.choice(40, 16, replace=False) for _ in range(5)])
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    expected = [plain(points[rows], normal) for rows, normal in zip(neighbours, normals, strict=True)]
    # The ridge takes a share of 1e-9 of the squares at most for noise.
    np.testing.assert_allclose(residuals_of(points, neighbours, normals), expected, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
def test_a_quadric_leaves_nothing_of_itself(normal: tuple[float, ...]) -> None:
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-1.0, 1.0, size=(2, 16))
    frame = np.linalg.svd(np.array([normal]))[2][[1, 2, 0]]
    points = np.stack([u, v, 0.3 * u * u - 0.2 * u * v + 0.1 * v], axis=1) @ frame
    assert residuals_of(points, np.arange(16)[None], frame[2:])[0] < 1e-8


def test_neighbours_on_a_line_say_nothing() -> None:
    points = np.outer(np.arange(16.0), [1.0, 2.0, 0.0]) + 1e-3 * np.random.default_rng(2).normal(size=(16, 3))
    assert np.isnan(residuals_of(points, np.arange(16)[None], np.array([[0.0, 0.0, 1.0]]))[0])


def test_systems_are_solved() -> None:
    rows = np.random.default_rng(3).normal(size=(9, 6))
    squares, right = rows.T @ rows + RIDGE * np.eye(6), rows.T @ np.ones(9)
    found = right.copy()
    solve(squares.copy(), found)
    np.testing.assert_allclose(squares @ found, right, rtol=0.0, atol=1e-12)
