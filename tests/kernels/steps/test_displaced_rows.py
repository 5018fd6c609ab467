"""How far residuals follow a displacement, beside NumPy's way to say it."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.steps.displaced_rows import displaced_rows, followed_share

SCALE, LIMIT = 1.4826, 2.0


def columns(seed: int, count: int) -> tuple[FloatArray, ...]:
    """Weights, points, feet, normals; some without weight, some without normal."""
    rng = np.random.default_rng(seed)
    moved, feet, normals = rng.normal(size=(3, count, 3))
    normals *= rng.uniform(size=(count, 1)) > 0.2
    return np.where(rng.uniform(size=count) < 0.2, 0.0, rng.uniform(size=count)), moved, feet, normals


@pytest.mark.parametrize("most", [1, 2, 40, 200])
@pytest.mark.parametrize("count", [0, 1, 2, 41, 90])
def test_rows_are_spread_evenly_and_displaced_by_their_usual_size(count: int, most: int) -> None:
    weights, moved, feet, normals = given = columns(count, count)
    rows, points = np.zeros(2 * most, dtype=np.int64), np.zeros((2 * most, 3))
    found, size = displaced_rows(*given, SCALE, LIMIT, rows, points)
    usable = np.flatnonzero((weights > 0.0) & normals.any(axis=1))
    if not len(usable):
        assert (found, size) == (0, 0.0)
        return
    usable = usable[sample_rows(len(usable), most)]
    residuals = np.abs(((moved - feet) * normals).sum(axis=1))[usable]
    assert size == pytest.approx(SCALE * np.median(residuals), rel=1e-14)
    kept = usable[residuals <= LIMIT * size]
    np.testing.assert_array_equal(rows[: 2 * found], np.concatenate([kept, kept]))
    steps = np.repeat([size, -size], len(kept))[:, None] * normals[rows[: 2 * found]]
    np.testing.assert_allclose(points[: 2 * found], moved[rows[: 2 * found]] + steps, rtol=0, atol=1e-14)


def test_nothing_is_displaced_where_half_of_the_residuals_are_zero() -> None:
    weights, moved, feet, normals = columns(3, 60)
    feet[:45] = moved[:45]
    rows, points = np.zeros(20, dtype=np.int64), np.zeros((20, 3))
    assert displaced_rows(weights, moved, feet, normals, SCALE, LIMIT, rows, points) == (0, 0.0)


def test_the_share_counts_what_is_left_of_both_displacements() -> None:
    points, feet, normals, before = np.random.default_rng(4).normal(size=(4, 60, 3))
    along = ((points - feet) * normals).sum(axis=1) * np.where((normals * before).sum(axis=1) < 0.0, -1.0, 1.0)
    along = np.clip(along, -LIMIT * 0.7, LIMIT * 0.7)
    expected = (along[:30].sum() - along[30:].sum()) / (60 * 0.7)
    assert followed_share(points, feet, normals, before, 0.7, LIMIT) == pytest.approx(expected, rel=1e-12)
    # A displacement from a plane is left as a whole.
    flat, up = np.zeros((60, 3)), np.tile([0.0, 0.0, 1.0], (60, 1))
    off = np.repeat([0.7, -0.7], 30)[:, None] * up
    assert followed_share(off, flat, up, up, 0.7, LIMIT) == pytest.approx(1.0)
