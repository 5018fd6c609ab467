from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.search.periods import near_periods
from dqreg.synth.parts import box, bracket, cylinder
from tests.search.periodic import pegs, stairs


def shifts_of(part: Mesh) -> np.ndarray:
    found = near_periods(part, MeshSurface(part))
    for T in found:
        np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=2e-3)
    return found[:, :3, 3]


@pytest.mark.parametrize(
    ("part", "period"),
    [
        (pegs(5, 4, 21.0), [21.0, 0.0, 0.0]),
        (pegs(5, 4, 21.0), [0.0, 21.0, 0.0]),
        (stairs(6, 24.0, 14.0), [24.0, 0.0, 14.0]),
        (stairs(5, 31.0, 18.0), [31.0, 0.0, 18.0]),
    ],
)
def test_the_period_that_a_part_was_built_with_is_found_either_way(part: Mesh, period: list[float]) -> None:
    # To a thousandth of the size: a registration refines what it tries.
    for sign in (1.0, -1.0):
        gaps = np.linalg.norm(shifts_of(part) - sign * np.array(period), axis=1)
        assert gaps.min() <= 1e-3 * part.diagonal


def test_no_period_is_a_multiple_of_a_shorter_one_and_the_opposite_of_each_is_there() -> None:
    shifts = shifts_of(pegs(5, 4, 21.0))
    half = len(shifts) // 2
    np.testing.assert_allclose(shifts[half:], -shifts[:half], atol=0.1)
    assert np.linalg.norm(shifts - [42.0, 0.0, 0.0], axis=1).min() > 5.0


@pytest.mark.parametrize("shape", [box((90.0, 60.0, 30.0)), bracket(), cylinder(diameter=20.0, height=80.0)])
def test_faces_that_slide_along_themselves_are_no_period(shape: tuple) -> None:
    assert len(shifts_of(Mesh(*shape))) == 0
