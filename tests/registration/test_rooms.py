"""Scans of a furnished room from several places: truth from the generator. A half-turn leaves its walls in place."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.synth.many_views import ManyViews, room_stops
from tests.strategies import FloatArray

HALF = np.diag([-1.0, -1.0, 1.0, 1.0])


@cache
def room(seed: int, rings: int) -> ManyViews:
    return room_stops(3, rings=rings, rng=np.random.default_rng(seed))


def stops(seed: int, rings: int, one: int, other: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Source and target, their pose, and that after the half-turn."""
    made = room(seed, rings)
    back, place = pose.inverse(made.T_world_scan[one]), made.T_world_scan[other]
    return made.scans[other], made.scans[one], back @ place, back @ HALF @ place


def away(T: FloatArray, truth: FloatArray, points: FloatArray) -> float:
    return float(np.linalg.norm(pose.apply(T, points) - pose.apply(truth, points), axis=1).max())


def test_a_right_pose_is_not_refused_for_where_rings_and_shadows_end_faces() -> None:
    source, target, truth, _ = stops(200, 32, 0, 2)
    result = dqreg.register(source, target, truth)
    assert result.verdict.level == "accepted"
    assert away(result.T_target_source, truth, source) < 0.02


@pytest.mark.parametrize(("seed", "rings", "one", "other"), [(200, 32, 1, 2), (201, 48, 0, 1)])
def test_a_search_finds_the_room_and_not_its_half_turn(seed: int, rings: int, one: int, other: int) -> None:
    source, target, truth, _ = stops(seed, rings, one, other)
    result = dqreg.register(source, target)
    assert away(result.T_target_source, truth, source) < 0.02
    assert result.verdict.level == "accepted"
    assert not result.alternatives


def test_the_half_turn_of_a_room_is_refused_and_mended_where_a_search_may() -> None:
    source, target, truth, half = stops(200, 32, 1, 2)
    refused = dqreg.register(source, target, half, search="never")
    assert away(refused.T_target_source, half, source) < 0.05
    assert refused.verdict.codes == ("looked_through",)
    mended = dqreg.register(source, target, half)
    assert away(mended.T_target_source, truth, source) < 0.02
    assert mended.verdict.level == "accepted"
