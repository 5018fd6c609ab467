"""Form of faces with few points, by lobes that are known: the shape that is fitted takes some of them."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.inspection.characteristics import form
from dqreg.inspection.features import fit_feature

ZONE, NOISE, RADIUS = 0.1, 0.003, 8.0


@pytest.mark.parametrize("lobes", [2, 3])
@pytest.mark.parametrize(("count", "heights"), [(10, [5.0]), (16, [5.0]), (16, [2.0, 8.0])])
def test_lobes_of_few_points_are_not_passed(count: int, heights: list[float], lobes: int) -> None:
    # Two lobes at one height are an axis that is tilted, as well: then the value is too small by more than is known.
    for seed in range(20_000, 20_010):
        rng = np.random.default_rng(seed)
        around = np.linspace(0.0, 2.0 * np.pi, count // len(heights), endpoint=False) + rng.uniform(0.0, 2.0 * np.pi)
        turn, z = (each.ravel() for each in np.meshgrid(around, heights))
        radii = RADIUS + 0.5 * ZONE * np.cos(lobes * turn)
        points = np.column_stack([radii * np.cos(turn), radii * np.sin(turn), z + rng.normal(0.0, 0.3, count)])
        points += rng.normal(0.0, NOISE, points.shape)
        found = form(fit_feature(points, "cylinder"), points, NOISE)
        assert found.decide(-np.inf, 0.5 * ZONE) != "pass"
        if lobes == 3:
            assert abs(found.value - ZONE) <= found.uncertainty + NOISE
