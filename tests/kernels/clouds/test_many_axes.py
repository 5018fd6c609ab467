from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.clouds.many_axes import AXES, LANES, ROWS, diagonalise_lanes
from dqreg.kernels.clouds.plane_fits import diagonalise
from dqreg.kernels.compiling.compiled import compiled

# Columns of a scatter, and elements that a matrix is given by.
FIRST, SECOND = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]


@compiled
def turn_lanes(count: int, lanes: FloatArray) -> None:
    diagonalise_lanes(count, lanes)


@compiled
def turn_one(a: FloatArray, v: FloatArray) -> None:
    diagonalise(a, v)


def matrices(count: int) -> np.ndarray:
    """Elements of scatters, one a column: full, flat, on a line, none, with elements whose squares vanish."""
    spread = np.random.default_rng(0).normal(size=(count, 3, 3)) * 10.0 ** np.linspace(0.0, 63.0, count)[:, None, None]
    spread[1::5, :, 2] = 0.0
    spread[2::5, :, 1:] = 0.0
    spread[3::5] *= np.eye(3)
    spread[4] = 0.0
    spread[5] = [[2.9e-213, 0.0, 0.0], [0.15625, 0.0, 0.0], [1.0, 0.0, 0.0]]
    return (spread @ spread.transpose(0, 2, 1))[:, FIRST, SECOND].T.copy()


@pytest.mark.parametrize("count", [0, 1, 7, LANES])
def test_many_at_once_have_the_bits_of_each_alone(count: int) -> None:
    elements, lanes = matrices(LANES), np.full((ROWS, LANES), np.nan)
    lanes[:AXES] = elements
    turn_lanes(count, lanes)
    for k in range(count):
        alone, axes = elements[:, k].copy(), np.zeros((3, 3))
        turn_one(alone, axes)
        assert np.array_equal(lanes[:AXES, k], alone)
        assert np.array_equal(lanes[AXES:, k].reshape(3, 3).T, axes)
    # Others are left as they are.
    assert np.array_equal(lanes[:AXES, count:], elements[:, count:])
