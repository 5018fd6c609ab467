"""Holes in the faces of a cloud that another one closes: how far beside one is looked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from dqreg.trust.closed_holes import grown


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_hole_grows_from_side_to_side_as_by_scipy(steps: int) -> None:
    rng = np.random.default_rng(steps)
    for shape in ((1, 1), (1, 9), (12, 7)):
        hole = rng.uniform(size=shape) < 0.1
        expected = binary_dilation(hole, iterations=steps) if steps else hole
        np.testing.assert_array_equal(grown(hole, steps), expected)
