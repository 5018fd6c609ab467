from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.kernels.clouds.plane_fits import diagonalise, fit_plane_rows
from dqreg.kernels.compiling.compiled import compiled
from dqreg.rigid import quaternion

components = st.floats(-1.0, 1.0)
# Of the elements that a matrix is given by.
ROWS, COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]


@compiled
def turn(a: FloatArray, v: FloatArray) -> None:
    diagonalise(a, v)


def least_axes(elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues, ascending, and the axis of the least, of matrices by their elements, (6, n)."""
    values, axes = np.zeros((elements.shape[1], 3)), np.zeros((elements.shape[1], 3))
    for k, matrix in enumerate(elements.T.copy()):
        vectors = np.zeros((3, 3))
        turn(matrix, vectors)
        values[k], axes[k] = np.sort(matrix[:3]), vectors[:, np.argmin(matrix[:3])]
    return values, axes


def symmetric(values: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj,nkj->nik", rotations, values, rotations)


def rotations(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return quaternion.to_matrix(q / np.linalg.norm(q, axis=1, keepdims=True))


def residual(matrices: np.ndarray, axes: np.ndarray, least: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.einsum("nij,nj->ni", matrices, axes) - least[:, None] * axes, axis=1)


@settings(deadline=None, max_examples=200)
@given(st.lists(components, min_size=9, max_size=9), st.floats(-12.0, 12.0))
@example([2.9e-213, 0.0, 0.0, 0.15625, 0.0, 0.0, 1.0, 0.0, 0.0], 1.0)  # Two rows whose products underflow
def test_any_scatter_has_the_values_and_the_least_axis_of_lapack(numbers: list[float], exponent: float) -> None:
    spread = np.array(numbers).reshape(3, 3) * 10.0**exponent
    matrix = spread @ spread.T
    values, axes = least_axes(matrix[ROWS, COLUMNS][:, None])
    expected = np.linalg.eigvalsh(matrix)
    size = max(expected[2], np.finfo(float).tiny)
    assert np.abs(values[0] - expected).max() <= 1e-7 * size
    assert abs(values[0, 0] - expected[0]) <= 1e-13 * size
    assert abs(np.linalg.norm(axes[0]) - 1.0) <= 1e-12
    assert residual(matrix[None], axes, values[:, 0])[0] <= 1e-9 * size


@pytest.mark.parametrize(
    "values",
    [
        (0.0, 1.0, 1.0),
        (0.0, 1.0, 1.0 + 1e-9),
        (1e-14, 1.0, 1e3),
        (1e-9, 1e-4, 1.0),
        (1e-3, 1.0, 2.0),
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 2.0),
        (0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0),
        (1.0, 1.0 + 1e-12, 1.0 + 2e-12),
    ],
)
def test_degenerate_scatters_keep_their_digits(values: tuple[float, float, float]) -> None:
    turns = rotations(200)
    matrices = symmetric(np.tile(values, (200, 1)), turns)
    found, axes = least_axes(np.ascontiguousarray(matrices[:, ROWS, COLUMNS].T))
    size = max(values[2], 1e-300)
    # What a residual of a flat neighbourhood is made of: the smallest value, to rounding.
    assert np.abs(found[:, 0] - values[0]).max() <= 3e-15 * size
    assert np.abs(found[:, 1:] - np.array(values)[1:]).max() <= 1e-7 * size
    assert np.abs(np.linalg.norm(axes, axis=1) - 1.0).max() <= 1e-12
    gap = values[1] - values[0]
    assert residual(matrices, axes, found[:, 0]).max() <= 1e-14 * size if gap <= 1e-6 else 1e-9 * size
    if gap > 1e-6 * size:
        aside = 1.0 - np.abs(np.einsum("nj,nj->n", axes, turns[:, :, 0]))
        assert aside.max() <= 1e-12 * size / gap


@pytest.mark.parametrize("values", [(0.0, 2e-5, 1.0), (1e-9, 1e-4, 1.0), (0.0, 1e-3, 1.0), (0.98, 1.0, 1.0)])
def test_the_axis_is_good_to_rounding_over_the_gap(values: tuple[float, float, float]) -> None:
    # No method beats the rounding of the elements over the gap between the eigenvalues.
    turns = rotations(1_000)
    matrices = symmetric(np.tile(values, (1_000, 1)), turns)
    _, axes = least_axes(np.ascontiguousarray(matrices[:, ROWS, COLUMNS].T))
    off = np.linalg.norm(np.cross(axes, turns[:, :, 0]), axis=1)
    assert off.max() <= 8.0 * np.finfo(float).eps / (values[1] - values[0])


def plain_fit(points: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Normal, residual and lever of one neighbourhood, by LAPACK."""
    centred = points - points.mean(axis=0)
    values, axes = np.linalg.eigh(centred.T @ centred)
    values = np.maximum(values, 0.0)
    return axes[:, 0], np.sqrt(values[0] / (len(points) - 3)), 1.0 / (len(points) / values[1:]).sum()


def test_fits_are_those_of_the_plain_ones() -> None:
    rng = np.random.default_rng(0)
    points, neighbours = rng.normal(size=(200, 3)) * [1.0, 0.7, 0.05], rng.integers(0, 200, size=(90, 12))
    normals, residuals, levers = np.zeros((90, 3)), np.zeros(90), np.zeros(90)
    for first in range(0, 90, 30):
        fit_plane_rows(first, first + 30, points, neighbours, normals, residuals, levers)
    for k in range(90):
        normal, residual, lever = plain_fit(points[neighbours[k]])
        assert abs(abs(normals[k] @ normal) - 1.0) < 1e-12
        np.testing.assert_allclose([residuals[k], levers[k]], [residual, lever], rtol=1e-10)
