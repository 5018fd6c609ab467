"""Distances of axes: the same whichever is first, wherever was scanned, with the truth from where the axes were put."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import fit_feature, inspect, measure_deviations
from dqreg.inspection.drawing.distances import distance
from dqreg.inspection.features import Feature
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import cylinder

TILT = math.radians(0.5)


def axis(start: Any, direction: Any, along: tuple[float, float], *, slope: float = 0.0) -> Feature:
    """A cylinder, or a cone, of radius 4 that was scanned from one length along its axis to another."""
    rng = np.random.default_rng(63_020)
    towards = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    one = np.cross(towards, [0.3, 0.5, -0.8])
    one /= np.linalg.norm(one)
    turn, length = rng.uniform(0.0, 2.0 * math.pi, 400), rng.uniform(*along, 400)
    outward = np.outer(np.cos(turn), one) + np.outer(np.sin(turn), np.cross(towards, one))
    points = np.asarray(start) + np.outer(length, towards) + (4.0 + slope * length)[:, None] * outward
    found = fit_feature(points, "cone" if slope else "cylinder", normals=outward)
    return found if found.axis @ towards > 0.0 else found.reversed()


def plane(height: float) -> Feature:
    flat = np.random.default_rng(63_021).uniform(-20.0, 20.0, (200, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, height]
    return fit_feature(flat, "plane", normals=np.tile([0.0, 0.0, 1.0], (200, 1)))


def both_ways(a: Feature, b: Feature, middle: FloatArray, ideal: tuple[Feature, ...]) -> float:
    one, other = distance(a, b, middle, ideal).value, distance(b, a, middle, ideal[::-1]).value
    assert one == pytest.approx(other, abs=1e-9)
    return one


@pytest.mark.parametrize("along", [(-20.0, 20.0), (5.0, 20.0), (-20.0, -5.0)])
@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_tilted_axes_are_compared_at_one_place(along: tuple[float, float], slope: float) -> None:
    upright, tilted = [0.0, 0.0, 1.0], [math.sin(TILT), 0.0, math.cos(TILT)]
    first, second = axis([0.0, 0.0, 0.0], upright, along, slope=slope), axis([30.0, 0.0, 0.0], tilted, along)
    ideal = axis([0.0, 0.0, 0.0], upright, (-1.0, 1.0)), axis([30.0, 0.0, 0.0], upright, (-1.0, 1.0))
    for height in (0.0, -12.0):
        # Across the bisector, half the tilt off, through (15, 0, height).
        reach = 15.0 + (15.0 * math.cos(TILT) + height * math.sin(TILT))
        found = both_ways(first, second, np.array([15.0, 0.0, height]), ideal)
        assert found == pytest.approx(reach / math.cos(0.5 * TILT), abs=1e-6)


@pytest.mark.parametrize("along", [(-20.0, 20.0), (5.0, 20.0)])
def test_an_axis_along_a_plane_is_compared_at_one_place(along: tuple[float, float]) -> None:
    tilted = axis([0.0, 0.0, 9.0], [math.cos(TILT), 0.0, math.sin(TILT)], along)
    ideal = plane(0.0), axis([0.0, 0.0, 9.0], [1.0, 0.0, 0.0], (-1.0, 1.0))
    found = both_ways(plane(0.0), tilted, np.array([10.0, 0.0, 9.0]), ideal)
    # Ten along the plane are ten times the cosine along the axis.
    assert found == pytest.approx(9.0 + 10.0 * math.cos(TILT) * math.sin(TILT), abs=1e-6)


@pytest.mark.parametrize("along", [(-20.0, 20.0), (5.0, 20.0)])
def test_axes_that_cross_are_apart_by_their_common_perpendicular(along: tuple[float, float]) -> None:
    first, second = axis([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], along), axis([7.0, 0.0, 3.0], [0.0, 1.0, 0.2], along)
    assert both_ways(first, second, np.zeros(3), (first, second)) == pytest.approx(7.0, abs=1e-6)


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_what_stands_on_a_plane_has_no_distance_from_it(slope: float) -> None:
    standing = axis([0.0, 0.0, 10.0], [0.0, 0.1, 1.0], (0.0, 20.0), slope=slope)
    with pytest.raises(InputError, match=f"a {standing.kind} whose axis is not along a plane .* two planes"):
        distance(plane(0.0), standing)


def test_a_plan_with_such_a_distance_is_refused_by_name() -> None:
    part = Mesh(*cylinder())
    scan = sample_mesh(part, 3_000, np.random.default_rng(0)).points
    found = measure_deviations(scan, part, MeshSurface(part), reach=1.0)
    top, wall = (part.corners[int(np.argmax(part.face_normals @ n))].mean(axis=0) for n in ([0, 0, 1.0], [1.0, 0, 0]))
    row = {"name": "height", "kind": "distance", "faces": [top.tolist(), wall.tolist()], "tolerance": 0.1}
    for nominal in ({}, {"nominal": 10.0}):
        with pytest.raises(InputError, match="characteristic 'height': a cylinder whose axis is not along a plane"):
            inspect(found, plan_of({"characteristic": [{**row, **nominal}]}))
