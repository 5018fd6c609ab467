"""Where faces beside a plane may turn to opposite sides: told by few points, as by all of them."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.trust.face_rims import Plane
from dqreg.trust.opposed_edges import SAME_RIM_SPACINGS, InPlane, _may_be_opposed
from tests.strategies import FloatArray

PLANE = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))


def in_plane(points: FloatArray, within: float) -> InPlane:
    points = points[distinct_in_order(points)]
    found = InPlane.of((points, NeighbourTree(points, in_order=True)), points[:, 2].copy(), PLANE, within)
    assert found is not None
    return found


def beside(one: InPlane, side: float) -> FloatArray:
    """Points in the plane that have one off it on a side within reach, (k, 3)."""
    points = one.cloud[0]
    flat, off = points[np.abs(points[:, 2]) < one.within], points[side * points[:, 2] > one.within]
    near = np.linalg.norm(flat[:, None] - off, axis=2) < one.reach
    return np.asarray(flat[near.any(axis=1)])


@pytest.mark.parametrize("above", [0.0, 0.3])
def test_edges_may_be_opposed_where_any_two_points_say_so(above: float) -> None:
    said = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        # Of slabs, as thick as a point reaches or less.
        clouds = [rng.uniform(-1.0, 1.0, (int(n), 3)) * (4.0, 4.0, 3.0) for n in rng.integers(400, 1_500, 2)]
        clouds[0][:, 2] += above
        within = rng.uniform(1.2, 2.9)
        one, other = (in_plane(points, within) for points in clouds)
        reach = SAME_RIM_SPACINGS * max(one.most_spacing, other.most_spacing)
        pairs = [(beside(one, side), beside(other, -side)) for side in (1.0, -1.0)]
        asked = any((np.linalg.norm(a[:, None] - b, axis=2) < reach).any() for a, b in pairs)
        said.append(_may_be_opposed(one, other))
        assert said[-1] == asked
    assert 5 < sum(said) < 35, sum(said)
