"""Walls too thick at one place and too thin at another: the place that counts is the one beyond its limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import inspect, measure_deviations, thickness_of
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.sheet.sheet_rows import Characteristic
from dqreg.synth.parts import box

THICK, SLOPE, NOISE = 4.0, 0.05, 0.005
PLATE = Mesh(*box((40.0, 30.0, THICK)))
RAMP = Mesh(
    PLATE.vertices + np.outer(PLATE.vertices[:, 0] * (PLATE.vertices[:, 2] > 0.0), [0.0, 0.0, SLOPE]), PLATE.faces
)


def stepped(x: FloatArray) -> FloatArray:
    """Of the upper side: 0.4 too high at one end, 0.3 too low at the other."""
    return np.where(x > 4.0, 0.4, np.where(x < -4.0, -0.3, 0.0))


def measured(mesh: Mesh, slope: float, error: Any, limits: dict[str, float]) -> Characteristic:
    rng = np.random.default_rng(63_010)
    points = rng.uniform(-1.0, 1.0, (6_000, 3)) * [19.5, 14.5, 0.0]
    up = np.arange(len(points)) % 2 == 0
    upper = 0.5 * THICK + slope * points[:, 0] + error(points[:, 0])
    points[:, 2] = np.where(up, upper, -0.5 * THICK) + rng.normal(0.0, NOISE, len(points))
    row = {"name": "wall", "kind": "thickness", "near": [0.0, 0.0, 0.5 * THICK], **limits}
    found = inspect(
        measure_deviations(points, mesh, MeshSurface(mesh), reach=1.5, noise=NOISE),
        plan_of({"expected_deviation": 1.0, "characteristic": [row]}),
    )
    return found.characteristics[0]


@pytest.mark.parametrize(
    ("limits", "value", "outcome"),
    [
        ({"plus": 0.5, "minus": 0.1}, 3.7, "fail"),
        ({"plus": 0.35, "minus": 0.5}, 4.4, "fail"),
        ({"plus": 0.5, "minus": 0.35}, 3.7, "pass"),
        ({"tolerance": 0.35}, 4.4, "fail"),
        # By limits of the drawing: 3.8 to 4.5, and 3.6 to 4.3.
        ({"nominal": 4.3, "plus": 0.2, "minus": 0.5}, 3.7, "fail"),
        ({"nominal": 3.9, "plus": 0.4, "minus": 0.3}, 4.4, "fail"),
    ],
)
def test_a_wall_is_told_where_it_is_beyond_its_limits(limits: dict[str, float], value: float, outcome: str) -> None:
    found = measured(PLATE, 0.0, stepped, limits)
    # Three standard deviations: of one draw of the noise.
    assert abs(found.value - value) <= 1.5 * found.uncertainty < 0.04
    assert found.outcome == outcome


@pytest.mark.parametrize(
    ("limits", "error", "outcome"),
    [
        ({"plus": 0.5, "minus": 0.1}, -0.3, "fail"),
        ({"plus": 0.35, "minus": 0.5}, 0.4, "fail"),
        ({"plus": 0.5, "minus": 0.35}, -0.3, "pass"),
    ],
)
def test_a_tapered_wall_is_compared_with_its_own_thickness_there(
    limits: dict[str, float], error: float, outcome: str
) -> None:
    found = measured(RAMP, SLOPE, stepped, limits)
    assert abs(found.value - found.nominal - error) <= 1.5 * found.uncertainty < 0.05
    assert abs(found.nominal - THICK) > 0.1
    assert (found.low, found.high) == pytest.approx((found.nominal - limits["minus"], found.nominal + limits["plus"]))
    assert found.outcome == outcome


def test_a_nominal_thickness_of_the_plan_is_that_of_a_tapered_wall_everywhere() -> None:
    # From 3.02 to 4.98 thick: 0.98 above and below 4.0, of which the drawing allows less below.
    found = measured(RAMP, SLOPE, np.zeros_like, {"nominal": 4.0, "plus": 1.2, "minus": 0.8})
    thinnest = THICK - SLOPE * 19.5
    # The last place lies within a neighbourhood of the rim.
    assert abs(found.value - thinnest) <= 0.05
    assert found.outcome == "fail"


def test_a_wall_with_a_step_is_within_its_uncertainty() -> None:
    # Half of the wall is 0.1 thicker: as many places compete to be the thickest as on a flat face.
    noise, part = 0.01, Mesh(*box((30.0, 20.0, 2.0)))
    surface, face = MeshSurface(part), int(faces_of(part)[1][int(np.argmax(part.face_normals[:, 2]))])
    for seed in range(20_950, 20_956):
        rng = np.random.default_rng(seed)
        points = sample_mesh(part, 12_000, rng).points.copy()
        normals = part.face_normals[surface.closest(points).elements]
        points[(normals[:, 2] > 0.5) & (points[:, 0] > 0.0), 2] += 0.1
        points += normals * (noise * rng.normal(size=len(points)))[:, None]
        wall = thickness_of(measure_deviations(points, part, surface, reach=0.9), face)
        assert abs(wall.value - 2.1) <= wall.uncertainty < 0.02
