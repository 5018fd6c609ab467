from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.icp.noise_by_face import BEFOREHAND, CELLS, LEAST, relative_precisions
from dqreg.kernels.threads import over_chunks
from dqreg.kernels.weighted_planes import COLUMNS, NUMBERS, mean_sums, plane_sums
from dqreg.solvers.quadratic import plane_form


def correspondences(seed: int, count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    points, feet, normals = rng.normal(size=(3, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = np.where(rng.random(count) < 0.3, 0.0, rng.random(count))
    normals[rng.random(count) < 0.1] = 0.0
    return points, feet, normals, weights


def sums_of(kernel, columns: tuple, shape: tuple[int, ...], chunk: int, *more: np.ndarray) -> np.ndarray:
    count = len(columns[0])
    sums = np.zeros((-(-count // chunk), *shape))
    over_chunks(kernel, count, *columns, *more, chunk, sums, chunk=chunk)
    return sums.sum(axis=0)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.integers(1, 20))
def test_sums_of_chunks_are_those_of_numpy(seed: int, count: int, chunk: int) -> None:
    points, feet, normals, weights = columns = correspondences(seed, count)
    used = (weights > 0.0) & normals.any(axis=1)
    p, q, n, w = points[used], feet[used], normals[used], weights[used]
    expected = np.r_[w.sum(), w @ p, w @ q, len(w)]
    np.testing.assert_allclose(sums_of(mean_sums, columns, (COLUMNS,), chunk), expected, rtol=1e-12, atol=1e-12)
    origins = np.random.default_rng(seed).normal(size=(2, 3))
    form = sums_of(plane_sums, columns, (NUMBERS, NUMBERS), chunk, origins)
    plain = plane_form(p, q, n, w, (origins[0], origins[1]))
    np.testing.assert_allclose(form, np.triu(plain), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("threads", ["1", "2", "8"])
def test_the_bits_are_the_same_for_any_number_of_threads(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = correspondences(0, 1_000)
    alone = sums_of(plane_sums, columns, (NUMBERS, NUMBERS), 100, np.zeros((2, 3)))
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    again = sums_of(plane_sums, columns, (NUMBERS, NUMBERS), 100, np.zeros((2, 3)))
    np.testing.assert_array_equal(again, alone)


def plain_precisions(normals: np.ndarray, squares: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The same by NumPy's sums over cells."""
    x, y, z = ((np.clip(normals.T, -1.0, 1.0) + 1.0) * (0.5 * CELLS) + 0.5).astype(np.int64)
    cells, count = (x * (CELLS + 1) + y) * (CELLS + 1) + z, (CELLS + 1) ** 3
    total, held = np.bincount(cells, weights * squares, count), np.bincount(cells, weights, count)
    usual = total.sum() / held.sum()
    factors = 1.0 / np.maximum((total + BEFOREHAND * usual) / (held + BEFOREHAND), LEAST * usual)
    return (factors * (held.sum() / (held @ factors)))[cells]


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-6, 1.0, 1e6]))
def test_precisions_are_those_of_numpy(seed: int, unit: float) -> None:
    _, _, normals, weights = correspondences(seed, 300)
    # On the rim of the cells, and beyond it by rounding.
    normals[:3], weights[:3] = np.eye(3) * (1.0 + 1e-15), 1.0
    squares = np.random.default_rng(seed).random(300) * unit
    found = relative_precisions(normals, squares, weights)
    used = weights > 0.0
    np.testing.assert_allclose(found[used], plain_precisions(normals, squares, weights)[used], rtol=1e-10)
    np.testing.assert_array_equal(found[~used], 1.0)
