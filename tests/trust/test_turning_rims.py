"""Rims beside which the faces turn up or down: a square with walls made by hand, and rims that are set."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.trust.limits import OPPOSED_EDGE_SHARE
from dqreg.trust.turning_rims import MIN_TURNING_RIMS, SharedTurning, Turning, shared_turning

SPACING = 0.1
# Of points in the plane.
WITHIN = 0.02


def walled(up: bool, down: bool) -> tuple[FloatArray, IntArray]:
    """Points of a square with a wall on one side, above it, below it, both or none, and the rows of that rim."""
    along = SPACING * np.arange(-8, 9)
    flat = np.stack(np.meshgrid(along, along, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    heights = SPACING * np.arange(1, 6)
    walls = [
        np.stack(np.meshgrid(along[-1:], along, sign * heights, indexing="ij"), axis=-1).reshape(-1, 3)
        for sign, told in ((1.0, up), (-1.0, down))
        if told
    ]
    rows = np.flatnonzero((flat[:, 0] == along[-1]) & (np.abs(flat[:, 1]) < 0.5))
    return np.concatenate([flat, *walls]), rows


def turning(points: FloatArray, rows: IntArray, normal: float = 1.0) -> Turning:
    outward = np.tile([1.0, 0.0, 0.0], (len(rows), 1))
    return Turning.of(rows, outward, (points, NeighbourTree(points)), normal * points[:, 2], WITHIN, SPACING)


@pytest.mark.parametrize("normal", [1.0, -1.0])
def test_a_face_turns_to_the_side_of_its_wall(normal: float) -> None:
    for up, down, side in ((True, False, 1.0), (False, True, -1.0)):
        points, rows = walled(up, down)
        found = turning(points, rows, normal)
        assert len(found.points) > 0.8 * len(rows)
        np.testing.assert_array_equal(found.side, normal * side)
        assert {tuple(x) for x in found.points.tolist()} <= {tuple(x) for x in points[rows].tolist()}
        assert len(found.outward) == len(found.points)


@pytest.mark.parametrize("both", [True, False])
def test_where_faces_turn_to_both_sides_or_to_none_nothing_is_said(both: bool) -> None:
    points, rows = walled(both, both)
    assert not len(turning(points, rows).points)


def test_what_is_no_face_turns_nowhere() -> None:
    # Rows of the wall's own, above the plane.
    points, _ = walled(True, False)
    assert not len(turning(points, np.flatnonzero(points[:, 2] > 3.5 * SPACING)).points)


def made(side: FloatArray, outward: float = 1.0, at: float = 0.0) -> Turning:
    """Rims along a line, each with a side."""
    points = np.column_stack([np.full(len(side), at), np.arange(len(side), dtype=float), np.zeros(len(side))])
    return Turning(points, np.tile([outward, 0.0, 0.0], (len(side), 1)), side)


def test_rims_of_both_are_alike_or_opposed() -> None:
    up = np.ones(40)
    assert shared_turning(made(up), made(up), 0.5) == SharedTurning(0.0, 40)
    assert shared_turning(made(up), made(-up), 0.5) == SharedTurning(1.0, 40)
    # A quarter of them is.
    some = np.where(np.arange(40) % 4, 1.0, -1.0)
    for pair in ((made(up), made(some)), (made(some), made(up))):
        assert shared_turning(*pair, 0.5) == SharedTurning(0.25, 40)


def test_those_that_look_another_way_or_lie_apart_are_of_other_faces() -> None:
    up = np.ones(40)
    for other in (made(-up, outward=-1.0), made(-up, at=0.6)):
        found = shared_turning(made(up), other, 0.5)
        assert found.told == 0
        assert np.isnan(found.opposed)
    # Where one near it turns the same way, it is not opposed.
    wavy = np.where(np.arange(40) % 2, 1.0, -1.0)
    assert shared_turning(made(up), made(wavy), 1.5) == SharedTurning(0.0, 40)


@pytest.mark.parametrize(("mine", "theirs"), [(MIN_TURNING_RIMS - 1, 40), (40, 3), (0, 0)])
def test_of_few_nothing_is_said(mine: int, theirs: int) -> None:
    found = shared_turning(made(np.ones(mine)), made(np.ones(theirs)), 0.5)
    assert np.isnan(found.opposed)
    assert not found.are_hardly_opposed


def test_many_rims_are_surer_than_few() -> None:
    assert not SharedTurning(0.0, 1).are_hardly_opposed
    assert SharedTurning(0.0, 10_000).are_hardly_opposed
    sure = [SharedTurning(0.5 * OPPOSED_EDGE_SHARE, told).are_hardly_opposed for told in (10, 100, 1_000, 10_000)]
    assert sure == sorted(sure)
    assert sure[-1]
    assert not SharedTurning(OPPOSED_EDGE_SHARE, 1_000_000).are_hardly_opposed
