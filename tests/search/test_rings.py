from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.rigid.rotations import about_axis
from dqreg.search import rings
from dqreg.search.rings import Ring, ring_flips, ring_steps
from dqreg.synth.parts import box
from tests.search.periodic import joined

# Square, so that its moments across its axis are equal.
BLOCK = Mesh(*box((4.0, 4.0, 1.5)))


def spokes(count: int) -> Mesh:
    """So many blocks around a hub."""
    angles = 2.0 * np.pi / count * np.arange(count)
    places = [(3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0) for angle in angles]
    return joined([(2.0, 2.0, 1.0), *[(0.6, 0.6, 1.0)] * count], [(0.0, 0.0, 0.0), *places])


@pytest.mark.parametrize("mesh", [BLOCK, spokes(6), spokes(9)], ids=["block", "six", "nine"])
def test_few_points_first_change_no_answer(mesh: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    surface = MeshSurface(mesh)
    ring = Ring.of(mesh, surface)
    found = ring_steps(ring), ring_flips(ring)
    # Oracle: all points at once.
    monkeypatch.setattr(rings, "MIN_HALF_TURN_GAIN", -1.0)
    monkeypatch.setattr(rings, "RING_SCREEN_STRIDE", 1)
    for some, all_of_them in zip(found, (ring_steps(ring), ring_flips(ring)), strict=True):
        np.testing.assert_array_equal(some, all_of_them)


def test_gains_that_leave_hope_are_those_of_all_points() -> None:
    ring = Ring.of(BLOCK, MeshSurface(BLOCK))
    assert ring is not None
    turns = about_axis(np.roll(ring.axis, 1), np.linspace(0.0, 2.0 * np.pi, 40))
    gains, every = ring.flip_gains(turns), ring.in_place(turns, lambda first: np.full(len(first), True))
    few = dataclasses.replace(ring, arms=ring.arms[:: rings.RING_SCREEN_STRIDE])
    hopeful = few.in_place(turns, lambda first: np.full(len(first), True)) >= rings.MIN_HALF_TURN_GAIN
    assert 0 < hopeful.sum() < 40
    np.testing.assert_array_equal(gains[hopeful], every[hopeful])
    assert every[~hopeful].max() < 2.0 * rings.MIN_HALF_TURN_GAIN
