from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.steps.pose_forms import NUMBERS, form_of_sums
from dqreg.kernels.steps.weighted_planes import COLUMNS, STEP, plane_sums, short_twist, step_sums
from dqreg.kernels.threads import over_chunks
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
    over_chunks(plane_sums, len(columns[0]), *columns, origins, chunk, sums, chunk=chunk)
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


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(10, 60), st.integers(5, 20), st.floats(1e-3, 1e3))
def test_a_short_motion_is_that_of_least_squares(seed: int, count: int, chunk: int, size: float) -> None:
    points, feet, normals, weights = correspondences(seed, count)
    points, feet, origin = size * points, size * feet, size * np.random.default_rng(seed).normal(size=3)
    sums, step = np.zeros((-(-count // chunk), STEP)), np.zeros(6)
    over_chunks(step_sums, count, points, feet, normals, weights, origin, chunk, sums, chunk=chunk)
    cost = short_twist(sums, 1e-9, step)
    root = np.sqrt(weights)
    rows = np.hstack([np.cross(points - origin, normals) / size, normals]) * root[:, None]
    heights = np.einsum("ij,ij->i", points - feet, normals) * root
    if (np.linalg.svd(rows)[1] ** 2)[[-1, 0]] @ (1.0, -1e-4) < 0.0:
        # Hardly held: in other units the limit lies elsewhere.
        return
    found, *_ = np.linalg.lstsq(rows, -heights)
    found[:3] /= size
    np.testing.assert_allclose(step, found, rtol=1e-7, atol=1e-9 * abs(found).max())
    left = rows @ (found * ([size] * 3 + [1.0] * 3)) + heights
    np.testing.assert_allclose(cost, left @ left, rtol=1e-7, atol=1e-12 * heights @ heights)


def test_of_one_face_no_short_motion_is_told() -> None:
    points, feet, normals, weights = correspondences(0, 30)
    normals[:] = [0.0, 0.0, 1.0]
    sums, step = np.zeros((1, STEP)), np.full(6, 7.0)
    step_sums(0, 30, points, feet, normals, weights, np.zeros(3), 30, sums)
    assert np.isnan(short_twist(sums, 1e-9, step))
    assert (step == 7.0).all()
