"""A thin part seen from a known place: the search may lay the scan onto the other sides of its walls."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose, twist
from dqreg.synth import Noise, Scanner, scan_mesh
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld

THICKNESS, NOISE = 1.5, 0.03


def channel() -> dqreg.Mesh:
    """A channel of 100 by 40 with walls of 25 and 30, a hole in its base and a notch in its lower wall."""
    x, y, z = (
        np.array([0.0, 20.0, 32.0, 60.0, 80.0, 100.0]),
        np.array([0.0, THICKNESS, 10.0, 18.0, 40.0 - THICKNESS, 40.0]),
        np.array([0.0, THICKNESS, 12.0, 25.0, 30.0]),
    )
    filled = np.zeros((5, 5, 4), dtype=bool)
    filled[:, :, 0] = filled[:, -1] = filled[:, 0, :3] = True
    filled[1, 2, 0] = filled[3, 0, 2:] = False
    return dqreg.Mesh(*weld(cells([x, y, z], filled)))


PART = channel()
TARGET = dqreg.prepare_target(PART)


@pytest.mark.parametrize("seed", [20001, 20034, 20040])
def test_a_right_viewpoint_leads_to_the_sides_that_were_seen_and_a_wrong_one_is_not_believed(seed: int) -> None:
    # Few points: the search found the other sides of the walls, where the loop with known sides finds nothing.
    rng = np.random.default_rng(seed)
    scan = scan_mesh(PART.vertices, PART.faces, Scanner([tuple(rng.standard_normal(3))], pixels=40),
                     Noise(range_sigma=NOISE), rng=rng)  # fmt: skip
    T = twist.exp(np.concatenate([rng.normal(size=3), 100.0 * rng.normal(size=3)]))
    points, eye = (pose.apply(pose.inverse(T), places) for places in (scan.points, scan.sensor_positions[:1]))
    result = TARGET.register(points, viewpoint=eye[0])
    assert result.verdict.level == "accepted"
    moved = pose.apply(result.T_target_source @ pose.inverse(T), PART.vertices)
    np.testing.assert_allclose(moved, PART.vertices, atol=10.0 * NOISE * np.sqrt(6.0 / len(points)))
    assert TARGET.register(points, viewpoint=2.0 * points.mean(axis=0) - eye[0]).verdict.level != "accepted"
