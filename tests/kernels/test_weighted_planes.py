from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.icp.noise_by_face import BEFOREHAND, CELLS, LEAST, relative_precisions
from dqreg.kernels.pose_forms import NUMBERS, form_of_sums
from dqreg.kernels.threads import over_chunks
from dqreg.kernels.weighted_planes import COLUMNS, NOTHING, plane_sums
from dqreg.solvers.quadratic import plane_form


def correspondences(seed: int, count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    points, feet, normals = rng.normal(size=(3, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = np.where(rng.random(count) < 0.3, 0.0, rng.random(count))
    normals[rng.random(count) < 0.1] = 0.0
    return points, feet, normals, weights


def form_of(columns: tuple, origins: np.ndarray, chunk: int) -> np.ndarray:
    """The form of the sums of chunks, and the origins it is about, which are moved there."""
    sums, form = np.zeros((-(-len(columns[0]) // chunk), COLUMNS)), np.zeros((NUMBERS, NUMBERS))
    over_chunks(plane_sums, len(columns[0]), *columns, NOTHING, 0, origins, chunk, sums, chunk=chunk)
    form_of_sums(sums, origins, form)
    return form


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.integers(1, 20))
def test_sums_of_chunks_are_those_of_numpy(seed: int, count: int, chunk: int) -> None:
    points, feet, normals, weights = columns = correspondences(seed, count)
    used = (weights > 0.0) & normals.any(axis=1)
    p, q, n, w = points[used], feet[used], normals[used], weights[used]
    origins = np.random.default_rng(seed).normal(size=(2, 3))
    form = form_of(columns, origins, chunk)
    if used.any():
        # Whatever the sums were taken from, the form is about the weighted means.
        np.testing.assert_allclose(origins, [w @ p / w.sum(), w @ q / w.sum()], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(form, plane_form(p, q, n, w, (origins[0], origins[1])), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("threads", ["1", "2", "8"])
def test_the_bits_are_the_same_for_any_number_of_threads(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = correspondences(0, 1_000)
    alone = form_of(columns, np.zeros((2, 3)), 100)
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    np.testing.assert_array_equal(form_of(columns, np.zeros((2, 3)), 100), alone)


def plain_precisions(normals: np.ndarray, squares: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The same by NumPy's sums over cells."""
    x, y, z = ((np.clip(normals.T, -1.0, 1.0) + 1.0) * (0.5 * CELLS) + 0.5).astype(np.int64)
    cells, count = (x * (CELLS + 1) + y) * (CELLS + 1) + z, (CELLS + 1) ** 3
    total, held = np.bincount(cells, weights * squares, count), np.bincount(cells, weights, count)
    usual = total.sum() / held.sum()
    factors = 1.0 / np.maximum((total + BEFOREHAND * usual) / (held + BEFOREHAND), LEAST * usual)
    return (factors * (held.sum() / (held @ factors)))[cells]


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-6, 1.0, 1e6]), st.booleans())
def test_precisions_are_those_of_numpy(seed: int, unit: float, spread: bool) -> None:
    moved, feet, normals, weights = correspondences(seed, 300)
    # On the rim of the cells, and beyond it by rounding.
    normals[:3], weights[:3] = np.eye(3) * (1.0 + 1e-15), 1.0
    moved, feet, scatter = unit * moved, unit * feet, unit**2 * np.random.default_rng(seed).random(300) * spread
    squares = np.einsum("ij,ij->i", moved - feet, normals) ** 2 + scatter
    found = relative_precisions(moved, feet, normals, weights, scatter if spread else 0.0).times(weights, normals)
    used = weights > 0.0
    np.testing.assert_allclose(found[used], (weights * plain_precisions(normals, squares, weights))[used], rtol=1e-10)
    np.testing.assert_array_equal(found[~used], 0.0)


def test_a_form_of_faces_weighed_by_their_scatter_is_that_of_the_weights_times_it() -> None:
    points, feet, normals, weights = correspondences(1, 500)
    precisions = relative_precisions(points, feet, normals, weights)
    sums, origins, form = np.zeros((1, COLUMNS)), np.zeros((2, 3)), np.zeros((NUMBERS, NUMBERS))
    columns = points, feet, normals, weights, precisions.of_cells, precisions.cells
    plane_sums(0, 500, *columns, origins, 500, sums)
    form_of_sums(sums, origins, form)
    expected = plane_form(points, feet, normals, precisions.times(weights, normals), (origins[0], origins[1]))
    np.testing.assert_allclose(form, expected, rtol=1e-11, atol=1e-11)
