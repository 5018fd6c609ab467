"""Zones of position and orientation on virtual faces, whose widths follow from the faults that were made."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Inspection, inspect, measure_deviations
from dqreg.inspection.drawing.zones import FaceScan, orientation
from dqreg.inspection.features import fit_feature
from dqreg.inspection.plan.file import plan_of
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box, bracket

NOISE = 0.005
SIZE = np.array([120.0, 80.0, 30.0])
BOX = Mesh(*box(tuple(SIZE)))
A, B, C = ({"name": name, "near": list(-0.5 * SIZE * axis)} for name, axis in zip("ABC", np.eye(3)[::-1], strict=True))
BRACKET = Mesh(*bracket())
# The bore of the bracket's boss lies along x, and is that long.
BORE, RADIUS, LENGTH = np.array([11.0, 32.0, 40.0]), 7.0, 22.0


def turned(points: np.ndarray, axis: int, degrees: float, about: np.ndarray) -> np.ndarray:
    step = np.zeros(6)
    step[axis] = np.deg2rad(degrees)
    return pose.apply(pose.about(twist.exp(step), about), points)


def box_scan(rng: np.random.Generator, count: int = 12_000) -> tuple[np.ndarray, np.ndarray]:
    """Points on the box without noise, and the normals of their faces."""
    cloud = sample_mesh(BOX, count, rng)
    return cloud.points.copy(), BOX.face_normals[MeshSurface(BOX).closest(cloud.points).elements]


def inspected(points: np.ndarray, normals: np.ndarray, rng: np.random.Generator, mesh: Mesh, **plan: Any) -> Inspection:
    noisy = points + rng.normal(0.0, NOISE, (len(points), 1)) * normals
    return inspect(measure_deviations(noisy, mesh, MeshSurface(mesh), reach=3.0, noise=NOISE), plan_of(plan))


def row(kind: str, near: Any, **more: Any) -> dict[str, Any]:
    return {"name": kind, "kind": kind, "near": [float(x) for x in near], "tolerance": 0.2, **more}


@pytest.mark.parametrize("seed", range(3))
def test_orientation_of_a_wall_counts_its_extent_across_the_tilt(seed: int) -> None:
    # A wall 80 wide and 30 high, tilted about its long direction: only its height counts.
    rng = np.random.default_rng(21_000 + seed)
    points, normals = box_scan(rng)
    on, middle, tilt = normals[:, 0] > 0.9, SIZE * [0.5, 0, 0], float(rng.uniform(0.05, 0.4))
    points[on] = turned(points[on], 1, tilt, middle)
    asked = [row("perpendicularity", middle, datum="A"), row("parallelism", middle, datum="C"),
             row("perpendicularity", middle, datum="B")]  # fmt: skip
    found = inspected(points, normals, rng, BOX, datum=[A, B, C], characteristic=asked).characteristics
    right = [SIZE[2] * np.sin(np.deg2rad(tilt))] * 2 + [0.0]
    for each, truth in zip(found, right, strict=True):
        assert abs(each.value - truth) <= each.uncertainty < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_orientation_of_a_plane_holds_its_waves(seed: int) -> None:
    rng = np.random.default_rng(21_100 + seed)
    points, normals = box_scan(rng)
    on, height = normals[:, 2] > 0.9, float(rng.uniform(0.1, 0.4))
    points[on, 2] += 0.5 * height * np.cos(4.0 * np.pi * points[on, 0] / SIZE[0])
    top = SIZE * [0, 0, 0.5]
    asked = [row("parallelism", top, datum="A"), row("perpendicularity", top, datum="B"), row("position", top)]
    found = inspected(points, normals, rng, BOX, datum=[A, B], alignment="best-fit", characteristic=asked)
    for each in found.characteristics:
        assert abs(each.value - height) <= each.uncertainty < 0.5 * height


def bore_scan(rng: np.random.Generator, tilt: float, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on the bracket whose bore is tilted about y and then moved, and their normals."""
    cloud = sample_mesh(BRACKET, 40_000, rng)
    points, normals = cloud.points.copy(), BRACKET.face_normals[MeshSurface(BRACKET).closest(cloud.points).elements]
    on = (np.abs(np.linalg.norm((points - BORE)[:, 1:], axis=1) - RADIUS) < 0.1) & (np.abs(normals[:, 0]) < 0.1)
    around = (points[on] - BORE) * [0, 1, 1]
    normals[on] = around / np.linalg.norm(around, axis=1)[:, None]
    points[on] = points[on] * [1, 0, 0] + BORE * [0, 1, 1] + RADIUS * normals[on]
    points[on] = turned(points[on], 1, tilt, BORE) + shift
    return points, normals


@pytest.mark.parametrize("seed", range(3))
def test_position_of_a_bore_is_the_worse_of_both_ends_of_its_axis(seed: int) -> None:
    rng = np.random.default_rng(21_200 + seed)
    tilt, shift = float(rng.uniform(0.2, 1.0)), np.array([0.0, *rng.uniform(-0.1, 0.1, 2)])
    points, normals = bore_scan(rng, tilt, shift)
    found = inspected(points, normals, rng, BRACKET, characteristic=[row("position", BORE - [0, 0, RADIUS])])
    # About y, what lies farther along x sinks.
    ends = [shift[1:] - [0.0, side * 0.5 * LENGTH * np.tan(np.deg2rad(tilt))] for side in (1, -1)]
    each = found.characteristics[0]
    assert abs(each.value - 2.0 * max(map(np.linalg.norm, ends))) <= each.uncertainty < 0.02
    assert each.outcome == "fail" or tilt < 0.7


def test_the_end_of_an_axis_that_was_not_scanned_counts_as_uncertain() -> None:
    points, normals = bore_scan(np.random.default_rng(21_300), 0.5, np.zeros(3))
    asked = [row("position", BORE - [0, 0, RADIUS])]
    deep = (np.linalg.norm((points - BORE)[:, 1:], axis=1) > RADIUS + 0.5) | (points[:, 0] < 8.0)
    whole, part = (
        inspected(points[rows], normals[rows], np.random.default_rng(0), BRACKET, characteristic=asked).characteristics[
            0
        ]
        for rows in (np.ones(len(points), dtype=bool), deep)
    )
    right = LENGTH * np.tan(np.deg2rad(0.5))
    for each in (whole, part):
        assert abs(each.value - right) <= each.uncertainty
    assert part.uncertainty > 2.0 * whole.uncertainty


def test_the_zone_of_a_bowed_face_reaches_its_rims() -> None:
    # Its farthest places lie at the rims, where the neighbours of a point lie to one side of it.
    x, y = np.random.default_rng(21_100).uniform([-60.0, -40.0], [60.0, 40.0], (2_500, 2)).T
    noise = NOISE * np.random.default_rng(21_101).normal(size=len(x))
    points = np.column_stack([x, y, 0.4 * (x / 60.0) ** 2 + noise])
    corners = np.array([[-60, -40, 0], [60, -40, 0], [60, 40, 0], [-60, 40, 0.0]])
    plane = fit_feature(points, "plane")
    # Without what the form adds to the uncertainty of the fitted plane: that of the zone alone.
    plane = dataclasses.replace(plane, covariance=np.zeros_like(plane.covariance))
    found = orientation(plane, fit_feature(corners, "plane"), FaceScan(points, corners, NOISE), 0.0)
    assert abs(found.value - 0.4) <= min(found.uncertainty, 0.015)
