"""What is asked of some rims and of some points first, against all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dqreg.trust import common_planes, shown_planes
from dqreg.trust.closed_holes import CLOSED, PERHAPS_CLOSED
from dqreg.trust.common_planes import CommonPlanes
from dqreg.trust.limits import CLOSED_HOLE_DIAGONALS, OPPOSED_EDGE_SHARE, SHARED_RIM_SHARE_OF_MANY_PLANES
from dqreg.trust.overlap import IndexedPoints, Overlap
from tests.strategies import FloatArray

SIZE, NOISE = 80.0, 0.02


def terraces(edges: tuple[float, float, float], seed: int, count: int, *, hole: float = 0.0) -> FloatArray:
    """Points of the faces of a block with two steps: five planes, and a hole in the lowest of them."""
    rng = np.random.default_rng(seed)
    sides = [(0, 0.0), (1, 0.0), (2, 0.0), (2, 6.0), (2, 12.0)]
    k = rng.integers(0, len(sides), count)
    points = rng.uniform(size=(count, 3)) * edges
    points[np.arange(count), np.array([axis for axis, _ in sides])[k]] = np.array([at for _, at in sides])[k]
    for number, low in ((3, 0.5), (4, 0.75)):
        points[k == number, 0] = edges[0] * (low + (1.0 - low) * points[k == number, 0] / edges[0])
    away = np.linalg.norm(points[:, :2] - np.array([12.0, 25.0]), axis=1) > hole
    points = points[(k != 2) | ((points[:, 0] < 0.5 * edges[0]) & away)]
    return points + NOISE * rng.normal(size=points.shape)


def between(one: FloatArray, other: FloatArray) -> CommonPlanes:
    sides, still = [IndexedPoints.of(points) for points in (one, other)], np.eye(4)
    overlap = Overlap.of(*sides, still)
    assert overlap is not None
    found = CommonPlanes.of(overlap, *sides, still, SIZE)
    assert found is not None
    assert found.are_all
    return found


BLOCK, LONGER = (45.0, 40.0, 30.0), (30.0, 55.0, 42.0)


@pytest.mark.parametrize(
    ("edges", "counts"), [(BLOCK, (4_000, 9_000)), (BLOCK, (9_000, 4_000)), (LONGER, (4_000, 5_000))]
)
def test_rims_of_the_sparser_cloud_are_no_more_than_those_of_the_cloud_that_has_more(
    edges: tuple[float, float, float], counts: tuple[int, int]
) -> None:
    planes = between(terraces(BLOCK, 1, counts[0]), terraces(edges, 2, counts[1]))
    assert not planes.are_a_corner
    all_of_one, error = planes.rims_of_one(rest=True)
    assert error == 0.0
    assert all_of_one <= planes.rims_shared()
    some, error = planes.rims_of_one(rest=False)
    assert error > 0.0
    assert abs(some - all_of_one) <= common_planes.CERTAIN_SIGMAS * error
    # Both are one question to the verdict.
    ends, shared = planes.ends_and_rims()
    assert (
        (shared >= SHARED_RIM_SHARE_OF_MANY_PLANES)
        == (planes.rims_shared() >= SHARED_RIM_SHARE_OF_MANY_PLANES)
        == (edges == BLOCK)
    )
    assert math.isnan(ends) == (edges == BLOCK)


def test_some_of_many_points_decide_as_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other, another = (terraces(edges, k, 26_000) for edges, k in ((BLOCK, 1), (BLOCK, 2), (LONGER, 3)))
    for pair, is_right in (((one, other), True), ((one, another), False)):
        planes = between(*pair)
        assert all(len(points) == shown_planes.FIRST_POINTS for points, _ in planes.shown.some.sides)
        by_some = planes.ends_and_rims()
        with monkeypatch.context() as patch:
            patch.setattr(shown_planes, "MANY_POINTS", 1 << 20)
            by_all = between(*pair).ends_and_rims()
        assert (
            (by_some[1] >= SHARED_RIM_SHARE_OF_MANY_PLANES)
            == (by_all[1] >= SHARED_RIM_SHARE_OF_MANY_PLANES)
            == is_right
        )
        if not is_right:
            assert by_some == by_all


def test_a_hole_that_some_points_show_is_measured_by_all(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = terraces(BLOCK, 1, 26_000, hole=5.0), terraces(BLOCK, 2, 26_000)
    planes = between(one, other)
    assert planes.closed_hole(SIZE) == planes.shown.hole(CLOSED) > CLOSED_HOLE_DIAGONALS * SIZE
    whole = between(terraces(BLOCK, 3, 26_000), other)
    asked = []
    monkeypatch.setattr(type(whole.shown), "hole", lambda self, asks: asked.append((self, asks)) or 0.0)
    assert whole.closed_hole(SIZE) == 0.0
    assert asked == [(whole.shown.some, PERHAPS_CLOSED)]


def test_what_known_rims_tell_of_opposed_edges_is_what_all_that_stands_beside_a_plane_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, other = terraces(BLOCK, 1, 8_000), terraces(BLOCK, 2, 8_000)
    upside_down = other * [1.0, 1.0, -1.0]
    for pair, most in (((one, other), 0.1), ((one, upside_down), 1.0)):
        planes = between(*pair)
        assert max(planes._hardly_opposed.values(), default=0.0) < OPPOSED_EDGE_SHARE
        by_rims = planes.opposed_edges()
        with monkeypatch.context() as patch:
            patch.setattr(CommonPlanes, "_know_rims", False)
            beside = between(*pair).opposed_edges()
        assert (by_rims > OPPOSED_EDGE_SHARE) == (beside > OPPOSED_EDGE_SHARE) == (most == 1.0)
        assert np.nan_to_num(by_rims) <= most
