from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.maps.swept_rows import SMALL, swept_rows
from dqreg.rigid import pose, twist


# About the angle below which series take over, at none, and beyond half a turn.
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3 * SMALL, 0.99 * SMALL, 1.01 * SMALL, 0.5, 4.0])
def test_each_point_moves_by_the_exponential_of_its_share_of_the_twist(angle: float) -> None:
    rng = np.random.default_rng(0)
    axis, points, back = rng.normal(size=3), rng.uniform(-50.0, 50.0, (40, 3)), -rng.uniform(0.0, 1.0, 40)
    back[:2] = 0.0, -1.0
    step = np.concatenate([angle * axis / np.linalg.norm(axis), [1.5, -0.7, 0.2]])
    moved = np.zeros_like(points)
    swept_rows(0, 40, points, back, step, moved)
    expected = np.stack([pose.apply(twist.exp(s * step), x[None])[0] for s, x in zip(back, points, strict=True)])
    # Rounding of coordinates of 50.
    np.testing.assert_allclose(moved, expected, rtol=0.0, atol=2e-13)
    np.testing.assert_array_equal(moved[0], points[0])
