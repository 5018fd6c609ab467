from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.evidence.plane_rows import plane_row_columns, strain_row_columns
from dqreg.kernels.threads import over_chunks
from dqreg.rigid import pose


def places(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, count, 3))
    return points, normals, rng.normal(size=3), pose.random(rng)[:3, :3].copy()


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(0.1, 10.0), st.integers(1, 50))
def test_motions_are_those_of_numpy(seed: int, count: int, lever: float, chunk: int) -> None:
    points, normals, centre, _ = places(seed, count)
    rows = np.zeros((6, count))
    over_chunks(plane_row_columns, count, points, normals, centre, lever, rows, chunk=chunk)
    expected = np.vstack([np.cross(points - centre, normals).T / lever, normals.T])
    np.testing.assert_allclose(rows, expected, rtol=1e-13, atol=1e-13)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(0.1, 10.0))
def test_strains_bends_and_torsion_are_displacements_along_the_normals(seed: int, count: int, lever: float) -> None:
    p, n, _, axes = places(seed, count)
    rows = np.zeros((9, count))
    strain_row_columns(0, count, p, n, axes, lever, rows)
    for row, (i, j) in zip(rows, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=False):
        E = np.zeros((3, 3))
        E[i, j] = E[j, i] = 1.0
        np.testing.assert_allclose(row, np.sum(p @ E * n, axis=1) / lever, rtol=1e-12, atol=1e-12)
    x, y, z = (p @ axes).T
    # A cross section is displaced by the square of its place, and rotates with the slope of that.
    for row, across, beside in ((rows[6], axes[:, 1], y), (rows[7], axes[:, 2], z)):
        moved = (x**2)[:, None] * across - (2.0 * x * beside)[:, None] * axes[:, 0]
        np.testing.assert_allclose(row, np.sum(moved * n, axis=1) / lever**2, rtol=1e-12, atol=1e-10)
    moved = x[:, None] * (z[:, None] * axes[:, 1] - y[:, None] * axes[:, 2])
    np.testing.assert_allclose(rows[8], np.sum(moved * n, axis=1) / lever**2, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one_are_no_special_cases(count: int) -> None:
    points, normals, centre, _ = places(0, count)
    rows = np.zeros((6, count))
    over_chunks(plane_row_columns, count, points, normals, centre, 1.0, rows)
    np.testing.assert_allclose(rows[3:], normals.T)
