"""Places that lie apart are on both sides of a wall where the faces beside them turn to opposite ways, else not."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.trust.limits import FACES_APART_SHARE
from dqreg.trust.overlap import IndexedPoints, Overlap
from dqreg.trust.wall_places import without_walls
from tests.strategies import FloatArray

SIZE, NOISE, DENSITY = 80.0, 0.02, 1.2
SURE, SAME = np.zeros((6, 6)), np.eye(4)
# Of the wall across the back plane: it stands out by 30 and is 40 high.
OUT, HIGH = 30.0, 40.0
Rectangle = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def faces(rng: np.random.Generator, *rectangles: Rectangle) -> FloatArray:
    """Points of rectangles along the axes, of which one edge has no length."""
    found = []
    for rectangle in rectangles:
        low, high = np.array(rectangle).T
        count = int(DENSITY * np.prod((high - low)[high > low]))
        found.append(rng.uniform(low, high, (count, 3)))
    points = np.concatenate(found)
    return points + NOISE * rng.normal(size=points.shape)


def seen(seed: int, side: float, low: float, high: float) -> FloatArray:
    """The back plane, with the top and the end of a wall between two places along x, and its face at one of them."""
    back = ((-40.0, 40.0), (0.0, 0.0), (0.0, HIGH))
    top, end = ((low, high), (-OUT, 0.0), (HIGH, HIGH)), ((low, high), (-OUT, -OUT), (0.0, HIGH))
    return faces(np.random.default_rng(seed), back, top, end, ((side, side), (-OUT, 0.0), (0.0, HIGH)))


def apart(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """What lies apart with the sides of walls, and without them."""
    sides = IndexedPoints.of(one), IndexedPoints.of(other)
    both = Overlap.of(*sides, SAME)
    assert both is not None
    return both.apart(SIZE, SURE), without_walls(both, *sides, SAME, SIZE).apart(SIZE, SURE)


@pytest.mark.parametrize("thick", [4.0, 8.0])
def test_both_sides_of_a_wall_lie_apart_by_what_it_is_thick(thick: float) -> None:
    before, after = apart(seen(0, 0.0, 0.0, thick), seen(1, thick, 0.0, thick))
    assert before > FACES_APART_SHARE
    assert after == 0.0


@pytest.mark.parametrize("moved", [4.0, 8.0])
def test_one_side_of_a_wall_at_two_places_lies_apart(moved: float) -> None:
    """The wall of another part is thicker, and that of one that moved stands elsewhere."""
    for other in (seen(1, -moved, -moved, 12.0), seen(1, -moved, -moved, 12.0 - moved)):
        before, after = apart(seen(0, 0.0, 0.0, 12.0), other)
        assert after == before > FACES_APART_SHARE


def test_faces_that_end_at_nothing_are_no_walls() -> None:
    """Of two sheets without a top or an end nothing tells the sides."""
    back = ((-40.0, 40.0), (0.0, 0.0), (0.0, HIGH))
    one, other = (
        faces(np.random.default_rng(seed), back, ((x, x), (-OUT, -5.0), (0.0, HIGH)))
        for seed, x in ((0, 0.0), (1, 4.0))
    )
    before, after = apart(one, other)
    assert after == before > FACES_APART_SHARE
