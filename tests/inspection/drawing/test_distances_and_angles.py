"""Distances and angles of tilted planes, whose truth follows from where the planes were put."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Inspection, inspect, measure_deviations
from dqreg.inspection.plan.file import plan_of
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box, prism

NOISE = 0.005
LENGTH, HEIGHT = 100.0, 20.0
BOX = Mesh(*box((LENGTH, 60.0, HEIGHT)))
TOP, BOTTOM = [0.0, 0.0, 0.5 * HEIGHT], [0.4 * LENGTH, 0.0, -0.5 * HEIGHT]
# A hexagon across corners of 60.
HEXAGON = Mesh(*prism(sides=6, diameter=60.0, height=40.0))


def sampled(mesh: Mesh, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    cloud = sample_mesh(mesh, 12_000, rng)
    return cloud.points.copy(), mesh.face_normals[MeshSurface(mesh).closest(cloud.points).elements]


def turned(points: np.ndarray, axis: int, degrees: float, about: Any) -> np.ndarray:
    step = np.zeros(6)
    step[axis] = np.deg2rad(degrees)
    return pose.apply(pose.about(twist.exp(step), np.array(about)), points)


def inspected(points: np.ndarray, normals: np.ndarray, mesh: Mesh, rows: list[dict[str, Any]], seed: int) -> Inspection:
    noisy = points + np.random.default_rng(seed).normal(0.0, NOISE, (len(points), 1)) * normals
    rows = [{"name": str(k), "tolerance": 0.1, **row} for k, row in enumerate(rows)]
    found = measure_deviations(noisy, mesh, MeshSurface(mesh), reach=3.0, noise=NOISE)
    return inspect(found, plan_of({"characteristic": rows}))


@pytest.mark.parametrize("seed", range(3))
def test_a_distance_of_planes_is_the_same_both_ways(seed: int) -> None:
    # The top is tilted about its middle; of the bottom one end alone was scanned. Their middles are a height apart.
    rng = np.random.default_rng(22_000 + seed)
    points, normals = sampled(BOX, rng)
    top, tilt = normals[:, 2] > 0.9, float(rng.uniform(0.05, 0.3))
    points[top] = turned(points[top], 1, tilt, TOP)
    seen = ~((normals[:, 2] < -0.9) & (points[:, 0] < 0.2 * LENGTH))
    rows = [{"kind": "distance", "faces": faces} for faces in ([TOP, BOTTOM], [BOTTOM, TOP])]
    one, other = inspected(points[seen], normals[seen], BOX, rows, seed).characteristics
    assert one.value == pytest.approx(other.value, rel=1e-12)
    assert one.uncertainty == pytest.approx(other.uncertainty, rel=1e-6)
    assert abs(one.value - HEIGHT) <= one.uncertainty < 0.05
    # What is not known of the bottom's middle counts: its scanned end lies far from there.
    assert one.uncertainty > 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_an_obtuse_angle_is_measured_as_the_drawing_says(seed: int) -> None:
    rng = np.random.default_rng(22_100 + seed)
    points, normals = sampled(HEXAGON, rng)
    sides = sorted(
        {tuple(n) for n in normals[np.abs(normals[:, 2]) < 0.1].round(6)}, key=lambda n: np.arctan2(n[1], n[0])
    )
    apothem, (first, second) = 30.0 * np.cos(np.pi / 6.0), np.array(sides[:2])
    tilt = float(rng.uniform(-0.3, 0.3))
    on = normals @ second > 0.999
    points[on] = turned(points[on], 2, tilt, apothem * second)
    # The second normal lies 60 degrees further about z: turned on by a tilt, the faces enclose so much less than 120.
    faces = {"kind": "angle", "faces": [(apothem * first).tolist(), (apothem * second).tolist()]}
    rows = [faces, {**faces, "nominal": 60.0}, {**faces, "nominal": 120.0}]
    found = inspected(points, normals, HEXAGON, rows, seed).characteristics
    for each, truth in zip(found, (60.0 + tilt, 60.0 + tilt, 120.0 - tilt), strict=True):
        assert abs(each.value - truth) <= each.uncertainty < 0.02
    assert [each.nominal for each in found] == pytest.approx([60.0, 60.0, 120.0])


@pytest.mark.parametrize("nominal", [-1.0, 180.5, 270.0])
def test_an_angle_that_no_two_faces_make_is_refused(nominal: float) -> None:
    row = {"name": "a", "kind": "angle", "faces": [TOP, BOTTOM], "nominal": nominal, "tolerance": 0.1}
    with pytest.raises(InputError, match=f"nominal of an angle is 0 to 180 degrees; got {nominal:g}"):
        plan_of({"characteristic": [row]})
