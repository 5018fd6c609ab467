"""A pose that rests on a corner of something larger is told from a part amid a scene."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg import Mesh, register
from dqreg._arrays import FloatArray
from dqreg.geometry import MeshSurface, sample_mesh
from dqreg.synth import Noise, Scanner, scan_mesh
from dqreg.synth.parts import box, bracket
from dqreg.trust.limits import GOING_ON_SHARE
from dqreg.trust.segments import share_going_on

CUBE = Mesh(*box((2.0, 2.0, 2.0)))


def going_on(points: FloatArray, width: float = 0.02) -> float:
    closest = MeshSurface(CUBE).closest(points)
    return share_going_on(points, closest.normals, closest.distances, width, CUBE.diagonal)


@pytest.mark.parametrize("times", [3.0, 10.0])
def test_a_corner_of_something_larger_goes_on_beyond_the_part(times: float) -> None:
    large = sample_mesh(Mesh(times * CUBE.vertices, CUBE.faces), int(40 * times**2), np.random.default_rng(0)).points
    # Corner on corner, from inside.
    assert going_on(large + (1.0 - times)) > GOING_ON_SHARE


@pytest.mark.parametrize("count", [60, 600, 6_000])
def test_a_part_on_a_table_ends_where_it_ends(count: int) -> None:
    rng = np.random.default_rng(1)
    part = sample_mesh(CUBE, count, rng).points
    table = rng.uniform(-10.0, 10.0, (15 * count, 3))
    table[:, 2] = -1.0
    beside = np.abs(table[:, :2]).max(axis=1) > 1.0
    scene = np.concatenate([part[part[:, 2] > -0.999], table[beside]])
    assert going_on(scene + 0.005 * rng.normal(size=scene.shape)) < 0.4 * GOING_ON_SHARE


def test_hardly_any_points_say_nothing() -> None:
    assert np.isnan(going_on(np.array([[1.0, 0.0, 0.0]] * 11 + [[3.0, 0.0, 0.0]] * 11)))


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (2, 3))])
def test_no_corner_of_a_scan_twelve_times_as_large_is_trusted(seed: int) -> None:
    # Inches that were read as feet: 40 to 80 points of one corner fit in three planes, and nothing else does.
    part, rng = bracket(), np.random.default_rng(seed)
    scan = scan_mesh(*part, Scanner(views=rng.normal(size=(2, 3)), pixels=100), Noise(range_sigma=0.03), rng=rng)
    result = register(12.0 * scan.points, Mesh(*part), units="ignore")
    assert result.verdict.level != "accepted", result.verdict.reasons
