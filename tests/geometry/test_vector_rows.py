from __future__ import annotations

import numpy as np

from dqreg.geometry.vector_rows import nonzero_rows, row_dots


def test_rows_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 50, 3))
    one[::7] = 0.0
    one[::5, 1:] = 0.0
    one[3, 0] = np.nan
    np.testing.assert_allclose(row_dots(one, other), np.einsum("ij,ij->i", one, other), rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(nonzero_rows(one), one.any(axis=1))
    # Views and no rows at all are taken too.
    np.testing.assert_array_equal(row_dots(one[1::2], other[1::2]), row_dots(one, other)[1::2])
    assert nonzero_rows(one[:0]).shape == (0,)
