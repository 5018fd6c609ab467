"""Translations that planes hold too little, stiffened: beside NumPy's eigenvectors of the same three rows."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.steps import free_shifts
from dqreg.kernels.steps.free_shifts import STIFF, hold_free_shifts
from tests.trust.shapes import unit

LIMIT = 1.0


@pytest.fixture(autouse=True)
def _plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_shifts, "_make_diagonal", free_shifts._make_diagonal.py_func)


def equations(values: list[float], seed: int, rows: int = 6) -> FloatArray:
    """Normal equations, (rows, rows), of which three from the fourth on have given eigenvalues."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    J = rng.normal(size=(2 * rows, rows))
    A = J.T @ J
    A[3:6, 3:6] = (axes * values) @ axes.T
    return A


def held(A: FloatArray, limit: float = LIMIT) -> FloatArray:
    """What is added to a matrix of which the lower half is given, made symmetric."""
    given = np.tril(A)
    # Compiled, the square of the ratio of what is nearly diagonal is infinite without a word.
    with np.errstate(over="ignore"):
        hold_free_shifts.py_func(given, 3, limit)
    assert not np.triu(given, 1).any()
    added = given - np.tril(A)
    return added + np.tril(added, -1).T


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "values",
    [
        [0.3, 5.0, 9.0],
        [0.95, 1.05, 9.0],
        [0.1, 0.2, 9.0],
        [0.1, 0.2, 0.3],
        [0.0, 5.0, 5.0],
        [0.0, 0.0, 4.0],
        [-1e-9, 3.0, 7.0],
    ],
)
def test_axes_of_less_information_than_the_limit_are_stiffened_alone(values: list[float], seed: int) -> None:
    A = equations(values, seed, rows=9)
    added = held(A)
    outside = np.ones((9, 9), dtype=bool)
    outside[3:6, 3:6] = False
    assert not added[outside].any()
    found, axes = np.linalg.eigh(A[3:6, 3:6])
    weak = axes[:, found < LIMIT]
    expected = STIFF * np.trace(A[3:6, 3:6]) * weak @ weak.T
    np.testing.assert_allclose(added[3:6, 3:6], expected, rtol=0, atol=1e-11 * STIFF * max(np.trace(A[3:6, 3:6]), 1.0))
    # A step along them is none; along the others it is what it was.
    step = np.linalg.solve(A[3:6, 3:6] + added[3:6, 3:6], rhs := np.array([1.0, -2.0, 0.5]))
    assert np.abs(weak.T @ step).max() < 1e-5 * np.linalg.norm(rhs)
    strong = axes[:, found >= LIMIT]
    np.testing.assert_allclose(strong.T @ step, (strong.T @ rhs) / found[found >= LIMIT], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("values", [[2.0, 3.0, 4.0], [1.001, 1.001, 1.001]])
def test_above_the_limit_nothing_is_touched(values: list[float]) -> None:
    assert not held(equations(values, 0)).any()


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_without_a_limit_nothing_is_held(limit: float) -> None:
    assert not held(equations([0.0, 0.0, 1.0], 0), limit).any()


def test_an_axis_of_the_frame_needs_no_rotation() -> None:
    A = np.diag([1.0, 1.0, 1.0, 4.0, 0.5, 6.0])
    np.testing.assert_array_equal(held(A), np.diag([0.0, 0.0, 0.0, 0.0, STIFF * 10.5, 0.0]))


def test_a_unit_of_information_is_no_matter() -> None:
    A = equations([0.3, 5.0, 9.0], 1)
    np.testing.assert_allclose(held(1e6 * A, 1e6 * LIMIT), 1e6 * held(A), rtol=1e-9, atol=1e-3)


def test_axes_are_found_to_rounding() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        J = rng.normal(size=(4, 3)) * rng.uniform(1e-3, 1.0, 3)
        M, axes = J.T @ J, np.eye(3)
        given = M.copy()
        with np.errstate(over="ignore"):
            free_shifts._make_diagonal(M, axes)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(axes.T @ given @ axes, np.diag(np.diag(M)), atol=1e-13)
        np.testing.assert_allclose(unit(axes.T), axes.T, atol=1e-14)
