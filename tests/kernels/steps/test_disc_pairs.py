from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.icp.estimators import CHUNK_PAIRS, plane_to_plane_form
from dqreg.kernels import threads
from dqreg.solvers.quadratic import plane_form, point_form


def plain(p, q, directions, variances, weights, origins) -> np.ndarray:
    """The sum of a point form and two plane forms that Woodbury's identity gives."""
    (n, m), (sure_n, sure_m) = directions, (1.0 - np.clip(variance, 0.0, 1.0) for variance in variances)
    a, b = sure_n * n.any(axis=1), sure_m * m.any(axis=1)
    cosine = np.einsum("ij,ij->i", n, m)
    along = n + (b * cosine / (2.0 - b))[:, None] * m
    k = a * (2.0 - b) / ((2.0 - a) * (2.0 - b) - a * b * cosine**2)
    half = 0.5 * weights
    form = point_form(p, q, half, origins) + plane_form(p, q, along, half * k, origins)
    return form + plane_form(p, q, m, half * b / (2.0 - b), origins)


def pairs(count: int, seed: int) -> tuple:
    rng = np.random.default_rng(seed)
    n, m = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in rng.normal(size=(2, count, 3)))
    n[rng.random(count) < 0.1] = 0.0
    m[rng.random(count) < 0.1] = 0.0
    p, q = rng.normal(size=(2, count, 3)) + 5.0
    weights = rng.random(count) * (rng.random(count) < 0.8)
    # Variances above 1 count as 1: such a normal says nothing.
    return p, q, (n, m), tuple(rng.uniform(0.01, 1.2, size=(2, count))), weights, (p[0], q[0])


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_the_sums_are_those_of_the_plain_forms(count: int, seed: int) -> None:
    arguments = pairs(count, seed)
    expected = plain(*arguments)
    np.testing.assert_allclose(plane_to_plane_form(*arguments), expected, atol=1e-13 * max(np.abs(expected).max(), 1.0))


def test_any_number_of_threads_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = pairs(3 * CHUNK_PAIRS + 7, 0)
    found = []
    for count in (1, 2, 5):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        found.append(plane_to_plane_form(*arguments).tobytes())
    assert len(set(found)) == 1
