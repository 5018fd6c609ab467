from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.search.pair_differences import pair_differences

SIDE, CELL, COSINE, SHORTEST, LONGEST = 9, 0.25, 0.5, 0.1, 0.9
LIMITS = np.array([COSINE, SHORTEST**2, LONGEST**2, CELL])
NONE = np.zeros(0, dtype=bool), np.zeros((0, 3)), np.zeros(0, dtype=np.int64)


def plain(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differences that count and their cells, pair by pair by NumPy."""
    first, second = np.triu_indices(len(points), 1)
    differences = points[second] - points[first]
    lengths = np.linalg.norm(differences, axis=1)
    kept = (np.sum(normals[first] * normals[second], axis=1) > COSINE) & (lengths > SHORTEST) & (lengths < LONGEST)
    cells = np.rint(differences[kept] / CELL).astype(np.int64) @ [SIDE**2, SIDE, 1] + SIDE**3 // 2
    return differences[kept], cells


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_differences_are_those_of_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = rng.random((count, 3)), rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    differences, cells = plain(points, normals)
    counts = np.zeros(SIDE**3, dtype=np.int32)
    assert pair_differences(points, normals, LIMITS, SIDE, counts, *NONE) == 0
    np.testing.assert_array_equal(counts, np.bincount(cells, minlength=SIDE**3))
    asked = rng.random(SIDE**3) < 0.2
    wanted = asked[cells] | asked[::-1][cells]
    found, places = np.zeros((len(cells), 3)), np.zeros(len(cells), dtype=np.int64)
    written = pair_differences(points, normals, LIMITS, SIDE, counts, asked, found, places)
    assert written == np.count_nonzero(wanted)
    np.testing.assert_array_equal(found[:written], differences[wanted])
    np.testing.assert_array_equal(places[:written], cells[wanted])
