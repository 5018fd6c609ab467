"""Distances of two features, each at one place that is the same whichever is the first and wherever was scanned.

Planes, and axes along each other or along a plane, are tilted in truth and apart by another distance at every place:
theirs is taken in the middle of both faces. Axes that cross are apart by their common perpendicular.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.drawing.characteristics import Measured, across, propagated
from dqreg.inspection.features import Feature

# Features are along each other where they are within a degree of it on the part itself.
ALONG_SIN = math.sin(math.radians(1.0))


def distance(
    first: Feature, second: Feature, middle: FloatArray | None = None, ideal: Sequence[Feature] = ()
) -> Measured:
    """Distance of two features: along the normal of a plane, across the axes of others, between centres.

    ``middle``, (3,), is where it is taken; default: half way between the features' points. ``ideal`` are both features
    on the part, which tell whether they are along each other; default: as measured.
    """
    kind = _distance_of(*(ideal or (first, second)))
    at = 0.5 * (first.point + second.point) if middle is None else middle
    return propagated(lambda f: kind(f[0], f[1], at), [first, second])


Distance = Callable[[Feature, Feature, FloatArray], float]


def _distance_of(a: Feature, b: Feature) -> Distance:
    """How two features are compared that are on the part as told."""
    if a.kind == "sphere" or b.kind == "sphere":
        return _from_centre
    turned = float(np.linalg.norm(np.cross(a.axis, b.axis)))
    if a.kind == "plane" and b.kind == "plane":
        return _between_planes
    if a.kind == "plane" or b.kind == "plane":
        other = b if a.kind == "plane" else a
        # The axis is along the plane where it is at right angles to the normal.
        if abs(float(a.axis @ b.axis)) > ALONG_SIN:
            raise InputError(
                f"a {other.kind} whose axis is not along a plane has another distance from it at every place: give the "
                "distance of two planes, or its position under datums with that plane"
            )
        return _from_plane
    return _between_axes if turned <= ALONG_SIN else _of_crossed_axes


def _from_centre(a: Feature, b: Feature, _: FloatArray) -> float:
    centre, other = (a, b) if a.kind == "sphere" else (b, a)
    if other.kind == "plane":
        return abs(float((centre.point - other.point) @ other.axis))
    return across(centre.point, other)


def _between_planes(a: Feature, b: Feature, middle: FloatArray) -> float:
    towards = _bisector(a, b)
    met = [float((plane.point - middle) @ plane.axis) / float(towards @ plane.axis) for plane in (a, b)]
    return abs(met[0] - met[1])


def _from_plane(a: Feature, b: Feature, middle: FloatArray) -> float:
    plane, other = (a, b) if a.kind == "plane" else (b, a)
    place = other.point + float((middle - other.point) @ other.axis) * other.axis
    return abs(float((place - plane.point) @ plane.axis))


def _between_axes(a: Feature, b: Feature, middle: FloatArray) -> float:
    towards = _bisector(a, b)
    one, two = (
        each.point + float((middle - each.point) @ towards) / float(each.axis @ towards) * each.axis for each in (a, b)
    )
    return float(np.linalg.norm(one - two))


def _of_crossed_axes(a: Feature, b: Feature, _: FloatArray) -> float:
    normal = np.cross(a.axis, b.axis)
    return abs(float((a.point - b.point) @ normal)) / float(np.linalg.norm(normal))


def _bisector(a: Feature, b: Feature) -> FloatArray:
    along = a.axis + math.copysign(1.0, float(a.axis @ b.axis)) * b.axis
    return np.asarray(along / np.linalg.norm(along))
