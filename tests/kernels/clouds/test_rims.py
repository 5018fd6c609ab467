from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.clouds.rims import known_rims, line_rows, one_sided_rows

SHARE, LINE = 0.25, 0.15


def plain_lines(spread: np.ndarray) -> np.ndarray:
    """Ratio of the second to the first variance of neighbours, (m, k, 3)."""
    centred = spread - spread.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.matmul(centred.transpose(0, 2, 1), centred))
    return values[:, 1] / values[:, 2]


def plain_sides(spread: np.ndarray, normals: np.ndarray, farthest: np.ndarray) -> np.ndarray:
    """Distance of the mean within the plane, in that of the farthest."""
    middle = spread.mean(axis=1)
    aside = middle - np.einsum("ij,ij->i", middle, normals)[:, None] * normals
    return np.linalg.norm(aside, axis=1) / farthest


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(2, 24))
def test_lines_and_sides_are_those_of_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(60, 3)) * 10.0 ** rng.uniform(-1.0, 0.0, 3)
    rows = rng.permutation(60)[:30].astype(np.int64)
    others = rng.permuted(np.tile(np.arange(60), (30, 1)), axis=1)[:, :count]
    neighbours = np.column_stack([rows, others]).astype(np.int32)
    normals = rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    spread = points[neighbours[:, 1:]] - points[rows][:, None]
    farthest = np.linalg.norm(spread, axis=2).max(axis=1) + 1e-3
    lines, sides = np.zeros(30, dtype=bool), np.zeros(30, dtype=bool)
    line_rows(0, 30, points, neighbours, LINE, lines)
    one_sided_rows(0, 30, points, rows, neighbours, farthest, normals, SHARE, LINE, sides)
    ratio, aside = plain_lines(spread), plain_sides(spread, normals, farthest)
    # Within rounding of a limit either answer is right.
    clear = np.abs(ratio - LINE) > 1e-9
    np.testing.assert_array_equal(lines[clear], (ratio <= LINE)[clear])
    clear &= np.abs(aside - SHARE) > 1e-9
    np.testing.assert_array_equal(sides[clear], ((aside > SHARE) & (ratio > LINE))[clear])


def test_what_is_known_of_a_rim_is_looked_up_and_the_rest_is_listed() -> None:
    rows = np.array([3, 1, 1, 0, 2, 1, 3])
    is_rim, known = np.array([False, True, True, False]), np.array([True, False, True, False])
    found, lines = np.zeros(7, dtype=bool), np.full(7, -1)
    assert known_rims(rows, is_rim, known, found, lines) == 4
    assert lines[:4].tolist() == [0, 1, 5, 6]
    np.testing.assert_array_equal(found[known[rows]], is_rim[rows][known[rows]])
