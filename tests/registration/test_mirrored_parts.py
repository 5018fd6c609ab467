"""The other-hand part is never taken for the part, and one that is its own mirror image always is."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg._arrays import FloatArray
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld

NOISE_DIAGONALS = 4e-4


def edges(rng: np.random.Generator, length: float, count: int, *, even: bool) -> FloatArray:
    """Ends of so many pieces of a length, random ones, or such that the pieces are the same from either end."""
    pieces = rng.uniform(0.4, 1.0, count)
    pieces = pieces + pieces[::-1] if even else pieces
    return np.asarray(np.concatenate([[0.0], np.cumsum(pieces)]) * length / pieces.sum())


def plate(rng: np.random.Generator, *, even: bool) -> dqreg.Mesh:
    """A plate with three through-holes and one boss anywhere; or of two halves, each the mirror image of the other."""
    x, y, z = edges(rng, 100.0, 9, even=even), edges(rng, 60.0, 7, even=False), np.array([0.0, 10.0, 20.0])
    filled = np.zeros((9, 7, 2), dtype=bool)
    filled[:, :, 0] = True
    inner = [(i, j) for i in range(1, 8) for j in range(1, 6) if (i + j) % 2]
    holes = [inner[k] for k in rng.permutation(len(inner))[:4]]
    for i, j in holes[:3]:
        filled[i, j, 0] = False
    filled[holes[3][0], holes[3][1], 1] = True
    if even:
        filled[:, :, 0] &= filled[::-1, :, 0]
        filled[:, :, 1] |= filled[::-1, :, 1]
    return dqreg.Mesh(*weld(cells([x, y, z], filled)))


def mirrored(part: dqreg.Mesh, rng: np.random.Generator) -> dqreg.Registration:
    """A noisy scan of the mirror image, from anywhere, registered to the part."""
    points = sample_mesh(part, 8_000, rng).points
    points = points + NOISE_DIAGONALS * part.diagonal * rng.normal(size=points.shape)
    points = pose.apply(pose.random(rng, reach=50.0), points * np.array([-1.0, 1.0, 1.0]))
    return dqreg.register(points, part, effort="fast")


@pytest.mark.parametrize("seed", range(4))
def test_the_mirror_image_of_a_plate_with_holes_and_a_boss_is_not_taken_for_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    verdict = mirrored(plate(rng, even=False), rng).verdict
    assert verdict.level == "suspect"
    assert "mirrored" in verdict.codes


@pytest.mark.parametrize("seed", range(2))
def test_a_plate_that_is_its_own_mirror_image_is_taken_for_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    verdict = mirrored(plate(rng, even=True), rng).verdict
    assert verdict.level == "accepted"
    assert "mirrored" not in verdict.codes
