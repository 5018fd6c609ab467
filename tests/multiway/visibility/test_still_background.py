"""A part that turns before a backdrop: what stands still must not be taken for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.multiway.pairwise.pairs import Order
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import View, read_views
from dqreg.multiway.visibility.still_background import unmoved_scans
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import Mesh, bracket, plate
from tests.multiway.edges_of_truth import registration

COUNT, NOISE = 5, 0.05
WHERE_THEY_ARE = np.tile(np.eye(4), (COUNT, 1, 1))


@cache
def turned(part: Callable[[], Mesh] = bracket) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Scans of a part on a table in the scanner's frame, and their true T_world_scan."""
    many = turntable_views(part(), COUNT, pixels=60, rng=np.random.default_rng(23500))
    return many.scans, many.T_world_scan


@cache
def before_backdrop(part: Callable[[], Mesh] = bracket) -> tuple[View, ...]:
    """The same before two walls that stand still."""
    scans, rng = turned(part)[0], np.random.default_rng(23501)
    low, high = np.concatenate(scans).min(axis=0), np.concatenate(scans).max(axis=0)
    found = []
    for scan in scans:
        walls = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (4000, 3))
        walls[:2000, 0], walls[2000:, 1] = high[0] + 20.0, high[1] + 20.0
        found.append(np.concatenate([scan, walls + NOISE * rng.normal(size=walls.shape)]))
    return read_views(found, 0, None)


def told(
    views: tuple[View, ...], T: FloatArray = WHERE_THEY_ARE, order: Order = "any", *, started: bool = False
) -> list[str]:
    edges = [
        dataclasses.replace(Edge(k, k + 1, registration(np.eye(4), np.eye(6), np.zeros(3))), used=True)
        for k in range(COUNT - 1)
    ]
    return [reason.code for reason in unmoved_scans(views, edges, T, order, started=started)]


def test_plates_that_hardly_cross_themselves_are_not_taken_for_aligned_scans() -> None:
    assert told(before_backdrop(plate)) == ["unmoved_scans"]
    scans, T = turned(plate)
    assert not told(read_views([pose.apply(T[k], scan) for k, scan in enumerate(scans)], 0, None))


@pytest.mark.parametrize("order", ["any", "turntable"])
def test_what_stands_still_is_not_taken_for_the_part(order: Order) -> None:
    assert told(before_backdrop(), order=order) == ["unmoved_scans"]


def test_scans_that_moved_are_not_doubted() -> None:
    # By where the part is: the walls cross then.
    assert not told(before_backdrop(), turned()[1])
    assert not told(before_backdrop(), turned()[1], "turntable")


def test_scans_that_starts_put_into_one_frame_are_not_doubted() -> None:
    assert not told(before_backdrop(), started=True)


def test_scans_that_were_aligned_before_are_not_doubted() -> None:
    scans, T = turned()
    assert not told(read_views([pose.apply(T[k], scan) for k, scan in enumerate(scans)], 0, None))


def test_scans_of_a_part_that_stood_still_are_not_doubted() -> None:
    rng, scan = np.random.default_rng(23502), turned()[0][0]
    views = read_views([scan + NOISE * rng.normal(size=scan.shape) for _ in range(COUNT)], 0, None)
    assert not told(views)
    # A table would have turned it.
    assert told(views, order="turntable") == ["unmoved_scans"]
