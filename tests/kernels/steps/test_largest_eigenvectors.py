from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.steps.largest_eigenvectors import LANES, largest_eigenvectors
from dqreg.solvers.closed_form import quaternion_form
from tests.solvers.exact_oracle import random_rotation

EPS = float(np.finfo(np.float64).eps)


def kernel(H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (b, 3) and vectors (b, 4) of the kernel for matrices (b, 3, 3)."""
    values, vectors = np.zeros((3, len(H))), np.zeros((4, len(H)))
    largest_eigenvectors(0, len(H), np.ascontiguousarray(np.moveaxis(H, 0, -1)), values, vectors)
    return values.T, vectors.T


def with_singular_values(rng: np.random.Generator, values: list[float], count: int) -> FloatArray:
    sides = [np.array([random_rotation(rng) for _ in range(count)]) for _ in range(2)]
    return sides[0] * np.array(values) @ sides[1]


@cache
def cases() -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    return {
        "any": rng.normal(size=(500, 3, 3)),
        "rotations": with_singular_values(rng, [1.0, 1.0, 1.0], 100),
        "planes": with_singular_values(rng, [1.0, 0.3, 0.0], 100),
        "mirrored": with_singular_values(rng, [1.0, 0.5, -0.4999], 100),
        "two rotations alike": with_singular_values(rng, [1.0, 0.5, -0.5], 100),
        "lines": with_singular_values(rng, [1.0, 0.0, 0.0], 100),
        "nearly lines": with_singular_values(rng, [1.0, 1e-9, 1e-12], 100),
        "in the axes": np.array([np.diag([3.0, 2.0, 1.0]), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, -2.0, 3.0])]),
        "large": 1e300 * rng.normal(size=(50, 3, 3)),
        "small": 1e-280 * rng.normal(size=(50, 3, 3)),
        "nothing": np.zeros((3, 3, 3)),
    }


@pytest.mark.parametrize("case", cases())
def test_values_and_vectors_are_those_of_lapack(case: str) -> None:
    H = cases()[case]
    values, vectors = kernel(H)
    size = np.abs(H).max(axis=(1, 2))
    N = np.array([quaternion_form(one) for one in H / np.where(size > 0.0, size, 1.0)[:, None, None]])
    expected, axes = np.linalg.eigh(N)
    # N's own norm is 9 units at most; the rest is rounding of either method.
    np.testing.assert_allclose(values / np.where(size > 0.0, size, 1.0)[:, None], expected[:, :0:-1], atol=60 * EPS)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=0, atol=2 * EPS)
    left = np.einsum("bij,bj->bi", N, vectors) - expected[:, 3:] * vectors
    assert np.abs(left).max() < 60 * EPS
    # A vector is as well determined as its eigenvalue lies apart from the next.
    apart = expected[:, 3] - expected[:, 2]
    across = np.linalg.norm(np.einsum("bij,bi->bj", axes[:, :, :3], vectors), axis=1)
    assert (across * apart < 60 * EPS).all()


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1])
def test_bits_of_a_form_do_not_depend_on_its_neighbours(count: int) -> None:
    H = np.concatenate([rows[:20] for rows in cases().values()])[:, ::-1]
    together = kernel(H)
    for start in range(0, len(H), count):
        alone = kernel(H[start : start + count])
        for one, all_ in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, all_[start : start + count])
    backwards = kernel(H[::-1])
    np.testing.assert_array_equal(backwards[1][::-1], together[1])
