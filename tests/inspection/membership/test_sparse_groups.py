"""A dent is a dent on a face that the scan shows at a glancing angle, with a tenth of the usual density."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import decide, measure_deviations
from dqreg.inspection.decision.decision import Decision
from dqreg.synth.parts import box

SIZE, THIN = np.array([60.0, 40.0, 20.0]), np.array([60.0, 40.0, 2.0])
NOISE, TOLERANCE = 0.015, 0.12


def scanned(size: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Points all over a box, but on its lower face far fewer per area; and which are on that."""
    # What is measured of a thin wall on one side alone is seen through it.
    spacing, fewer = 0.25, 10.0 if size is SIZE else 3.0
    sides = [(axis, end) for axis in range(3) for end in (-0.5, 0.5)]
    points, low = [], []
    for axis, end in sides:
        is_low = (axis, end) == (2, -0.5)
        area = np.prod(np.delete(size, axis))
        count = int(area / (fewer * spacing if is_low else spacing) ** 2)
        places = rng.uniform(-0.5, 0.5, (count, 3)) * size
        places[:, axis] = end * size[axis]
        points.append(places)
        low.append(np.full(count, is_low))
    return np.concatenate(points), np.concatenate(low)


def judged(points: FloatArray, size: FloatArray, rng: np.random.Generator) -> Decision:
    part = Mesh(*box(tuple(size)))
    noisy = points + rng.normal(scale=NOISE, size=points.shape)
    limit = 0.05 * part.diagonal
    return decide(measure_deviations(noisy, part, MeshSurface(part), limit=limit, noise=NOISE, tolerance=TOLERANCE))


def dented(size: FloatArray, depth: float, rng: np.random.Generator) -> FloatArray:
    """With a smooth dent or bump on the lower face, of a radius of ten."""
    points, low = scanned(size, rng)
    away = np.hypot(points[:, 0], points[:, 1])
    points[:, 2] -= np.where(low & (away < 10.0), depth * np.cos(away / 10.0 * np.pi / 2), 0.0)
    return points


@pytest.mark.parametrize("size", [SIZE, THIN], ids=["block", "thin"])
@pytest.mark.parametrize("depth", [-0.6, 0.6])
@pytest.mark.parametrize("seed", range(2))
def test_a_dented_face_fails_however_few_points_it_has(size: FloatArray, depth: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert judged(dented(size, depth, rng), size, rng).outcome == "fail"


@pytest.mark.parametrize("size", [SIZE, THIN], ids=["block", "thin"])
@pytest.mark.parametrize("strays", [0, 300, 3_000])
def test_strays_make_no_dent(size: FloatArray, strays: int) -> None:
    rng = np.random.default_rng(7)
    points = dented(size, 0.0, rng)
    wild = rng.uniform(-1.0, 1.0, (strays, 3)) * (0.5 * size + 3.0)
    assert judged(np.concatenate([points, wild]), size, rng).outcome == "pass"


def test_a_table_below_the_part_is_no_dent_of_it() -> None:
    # Seen at a glancing angle too, and no nearer than a spacing of its own.
    rng = np.random.default_rng(8)
    points = dented(SIZE, 0.0, rng)
    table = rng.uniform(-60.0, 60.0, (2_300, 3))
    table[:, 2] = -0.5 * SIZE[2] - 2.0
    assert judged(np.concatenate([points, table]), SIZE, rng).outcome == "pass"
