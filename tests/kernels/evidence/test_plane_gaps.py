"""Cells that hold points of a plane, and the gaps they enclose, against NumPy and the labels of SciPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import find_objects, label

from dqreg.kernels.evidence.plane_gaps import COLUMNS, enclosed_gaps, hold_cells


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 12), st.integers(1, 4), st.floats(0.2, 0.9))
def test_gaps_are_the_free_cells_that_hang_together_but_for_the_first(
    seed: int, height: int, width: int, least: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    own, theirs = rng.random((height, width)) < share, rng.random((height, width)) < 0.5
    labels, found = np.zeros(own.shape, dtype=np.int32), np.zeros((own.size // least + 1, COLUMNS), dtype=np.int64)
    known = enclosed_gaps(own, theirs, least, labels, np.zeros(own.size, dtype=np.int64), found)
    wanted, count = label(~own)
    # Both number them as they come, row by row.
    assert np.array_equal(labels, wanted)
    sizes, filled = (np.bincount(wanted.ravel(), side.ravel(), count + 1) for side in (np.ones_like(own), theirs))
    gaps = [k for k in range(2, count + 1) if sizes[k] >= least]
    assert found[:known, 0].tolist() == gaps
    assert found[:known, 1].tolist() == sizes[gaps].tolist()
    assert found[:known, 2].tolist() == filled[gaps].tolist()
    places = [find_objects(wanted)[k - 1] for k in gaps]
    ends = [[side.start if low else side.stop - 1 for side in place for low in (True, False)] for place in places]
    assert found[:known, 3:].tolist() == ends


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 3.0))
def test_cells_hold_what_lies_in_them(seed: int, cell: float) -> None:
    rng = np.random.default_rng(seed)
    flat, low, cells = rng.uniform(-3.0, 3.0, (50, 2)), rng.uniform(-3.0, 0.0, 2), np.zeros((4, 7), dtype=bool)
    hold_cells(flat, low, cell, cells)
    corners = low + cell * np.stack(np.meshgrid(np.arange(4), np.arange(7), indexing="ij"), axis=-1)
    inside = (flat >= corners[:, :, None] + 1e-9) & (flat < corners[:, :, None] + cell - 1e-9)
    near = (flat >= corners[:, :, None] - 1e-9) & (flat < corners[:, :, None] + cell + 1e-9)
    assert not (inside.all(axis=-1).any(axis=-1) & ~cells).any()
    assert not (cells & ~near.all(axis=-1).any(axis=-1)).any()
