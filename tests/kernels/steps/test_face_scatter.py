from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.icp.noise_by_face import (
    CELL_PRIOR_PAIRS,
    CELLS_PER_AXIS,
    FACE_PRIOR_PAIRS,
    MIN_VARIANCE_RATIO,
    PART_NUMBERS,
    relative_precisions,
)
from dqreg.kernels.steps.face_scatter import square_heights
from dqreg.kernels.threads import over_chunks
from tests.kernels.steps.test_weighted_planes import correspondences


def plain_precisions(
    normals: np.ndarray, squares: np.ndarray, weights: np.ndarray, faces: np.ndarray, parts: np.ndarray
) -> np.ndarray:
    """The same by NumPy's sums over cells, faces and parts on them."""

    def variances(keys: np.ndarray, beforehand: float, usual: np.ndarray | float) -> np.ndarray:
        total, held = np.bincount(keys, weights * squares), np.bincount(keys, weights)
        return (total[keys] + beforehand * usual) / (held[keys] + beforehand)

    x, y, z = ((np.clip(normals.T, -1.0, 1.0) + 1.0) * (0.5 * CELLS_PER_AXIS) + 0.5).astype(np.int64)
    usual = float(weights @ squares / weights.sum())
    found = variances((x * (CELLS_PER_AXIS + 1) + y) * (CELLS_PER_AXIS + 1) + z, CELL_PRIOR_PAIRS, usual)
    found = variances(faces, FACE_PRIOR_PAIRS, found)
    found = variances(faces * PART_NUMBERS + parts, FACE_PRIOR_PAIRS, found)
    factors = 1.0 / np.maximum(found, MIN_VARIANCE_RATIO * usual)
    return factors * (weights.sum() / (weights @ factors))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-12, 1.0, 1e12]), st.sampled_from([1, 5, 20]), st.booleans())
def test_precisions_are_those_of_numpy(seed: int, unit: float, most: int, whole: bool) -> None:
    _, _, of_faces, weights = correspondences(seed, 300)
    rng = np.random.default_rng(seed)
    # On the rim of the cells, and beyond it by rounding.
    of_faces[:3], weights[:3] = np.eye(3) * (1.0 + 1e-15), 1.0
    faces, parts = rng.integers(0, most, 300), rng.integers(0, PART_NUMBERS, 300).astype(np.uint8)
    normals, squares = of_faces[faces], unit * rng.random(300) ** 2
    found = relative_precisions(squares, normals, weights, faces, *(() if whole else (parts,)))
    factors = plain_precisions(normals, squares, weights, faces, 0 * parts if whole else parts)
    np.testing.assert_allclose(found, weights * factors, rtol=1e-10)
    assert found.sum() == pytest.approx(weights.sum(), rel=1e-12)


@pytest.mark.parametrize("threads", ["1", "2", "8"])
def test_the_bits_are_the_same_for_any_number_of_threads(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, normals, weights = correspondences(0, 50_000)
    rng = np.random.default_rng(0)
    asked = rng.random(50_000), normals, weights, rng.integers(0, 1_000, 50_000)
    alone = relative_precisions(*asked)
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    np.testing.assert_array_equal(relative_precisions(*asked), alone)


def test_faces_with_few_points_share_the_sums_of_their_orientation() -> None:
    rng = np.random.default_rng(1)
    normals, weights, squares = np.eye(3)[rng.integers(0, 3, 90)], np.ones(90), rng.random(90)
    found = relative_precisions(squares, normals, weights, rng.permutation(1_000_000)[:90])
    np.testing.assert_array_equal(
        found, relative_precisions(squares, normals, weights, (normals @ [0, 1, 2]).astype(np.int64))
    )


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_square_heights_are_those_of_numpy(seed: int, spread: bool) -> None:
    moved, feet, normals, weights = correspondences(seed, 50)
    scatter = np.random.default_rng(seed).random(50) if spread else np.zeros(0)
    squares = np.zeros(50)
    over_chunks(square_heights, 50, moved, feet, normals, weights, scatter, squares, chunk=7)
    heights = np.einsum("ij,ij->i", moved - feet, normals)
    expected = np.where(weights > 0.0, heights**2 + (scatter if spread else 0.0), 0.0)
    np.testing.assert_allclose(squares, expected, rtol=1e-12)
