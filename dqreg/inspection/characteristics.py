"""Characteristics of a drawing: sizes, distances, angles, form, orientation, position, profile; each with uncertainty.

Every value is a function of measured features (and, for zones, of points); its uncertainty follows from the features'
covariances, one parameter at a time. Decisions are those of ISO 14253-1: pass or fail is proven, or neither is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.decision import COVERAGE
from dqreg.inspection.features import Feature
from dqreg.inspection.medians import smoothed
from dqreg.inspection.regions import Outcome

# Step of the numerical derivatives, in standard deviations of a feature's parameters.
NUDGE = 1e-2


@dataclasses.dataclass(frozen=True)
class Measured:
    """A value with its uncertainty: a length, or an angle in degrees."""

    value: float
    uncertainty: float  # Expanded, k = 2, in the same unit

    def decide(self, low: float, high: float) -> Outcome:
        """Whether the value is proven to lie within its limits; undecided where one is within the uncertainty."""
        if self.value - self.uncertainty >= low and self.value + self.uncertainty <= high:
            return "pass"
        if self.value + self.uncertainty < low or self.value - self.uncertainty > high:
            return "fail"
        return "undecided"


def propagated(value: Callable[[Sequence[Feature]], float], features: Sequence[Feature]) -> Measured:
    """A function of features with the uncertainty that follows from their covariances, to first order."""
    found, total = value(features), 0.0
    for k, feature in enumerate(features):
        variances, vectors = np.linalg.eigh(feature.covariance)
        for variance, vector in zip(variances, vectors.T, strict=True):
            if variance > 0.0:
                step = NUDGE * math.sqrt(float(variance)) * vector
                changed = value([*features[:k], feature.nudged(step), *features[k + 1 :]])
                total += ((changed - found) / NUDGE) ** 2
    return Measured(found, COVERAGE * math.sqrt(total))


def diameter(feature: Feature) -> Measured:
    """Diameter of a circle, cylinder or sphere."""
    if feature.kind not in ("circle", "cylinder", "sphere"):
        raise InputError(f"a {feature.kind} has no diameter; circles, cylinders and spheres have")
    return propagated(lambda f: f[0].diameter, [feature])


def distance(first: Feature, second: Feature) -> Measured:
    """Distance of two features: along the normal of a plane, across the axes of others."""
    return propagated(lambda f: _distance(f[0], f[1]), [first, second])


def angle(first: Feature, second: Feature) -> Measured:
    """Angle between the normals or axes of two features, 0 to 90 degrees; a plane and an axis by the plane itself."""
    for feature in (first, second):
        if feature.kind == "sphere":
            raise InputError("a sphere has no direction, so no angle")
    return propagated(lambda f: _angle_deg(f[0], f[1]), [first, second])


def form(feature: Feature, points: FloatArray) -> Measured:
    """Flatness, straightness, roundness or cylindricity: the width of the zone that holds the surface.

    Of medians of 25 neighbouring points, which single points do not move. Noise of n medians widens the zone by
    ``2 sqrt(2 ln n)`` of their standard deviation at most: that is the uncertainty.
    """
    from dqreg.inspection.features import fit_feature

    places, sigma = _medians(feature, points)
    zone = fit_feature(places, feature.kind, method="chebyshev")
    return Measured(zone.form, 2.0 * sigma * math.sqrt(2.0 * math.log(max(len(places), 2))))


def orientation(feature: Feature, datum: Feature, points: FloatArray) -> Measured:
    """Parallelism or perpendicularity, whichever is nearer: width of the zone in the ideal direction to the datum."""
    extent = _extent(feature, points)
    return propagated(lambda f: extent * math.sin(math.radians(_off_square(f[0], f[1]))), [feature, datum])


def position(feature: Feature, nominal: Feature) -> Measured:
    """Diameter of the least zone about the nominal place that holds the feature: twice its distance from there."""
    if nominal.kind == "plane":
        return propagated(lambda f: 2.0 * abs(float((f[0].point - nominal.point) @ nominal.axis)), [feature])
    return propagated(lambda f: 2.0 * _across(f[0].point, nominal), [feature])


def profile(deviations: FloatArray, points: FloatArray) -> Measured:
    """Profile of a surface: twice the largest deviation of medians of 25 neighbouring points. Shapes: (n,), (n, 3)."""
    medians, sigma = smoothed(deviations, points)
    largest = float(np.abs(medians).max())
    return Measured(2.0 * largest, 2.0 * COVERAGE * sigma)


def _distance(a: Feature, b: Feature) -> float:
    if b.kind == "plane":
        return abs(float((a.point - b.point) @ b.axis))
    if a.kind == "plane":
        return abs(float((b.point - a.point) @ a.axis))
    if a.kind == "sphere" and b.kind == "sphere":
        return float(np.linalg.norm(a.point - b.point))
    return _across(a.point, b) if b.kind != "sphere" else _across(b.point, a)


def _across(point: FloatArray, feature: Feature) -> float:
    offset = point - feature.point
    if feature.kind == "sphere":
        return float(np.linalg.norm(offset))
    return float(np.linalg.norm(offset - (offset @ feature.axis) * feature.axis))


def _angle_deg(a: Feature, b: Feature) -> float:
    between = math.degrees(math.atan2(float(np.linalg.norm(np.cross(a.axis, b.axis))), abs(float(a.axis @ b.axis))))
    return 90.0 - between if (a.kind == "plane") != (b.kind == "plane") else between


def _off_square(a: Feature, b: Feature) -> float:
    # Degrees from parallel or from perpendicular, whichever is nearer.
    found = _angle_deg(a, b)
    return min(found, 90.0 - found)


def _extent(feature: Feature, points: FloatArray) -> float:
    offsets = points - feature.point
    along = offsets @ feature.axis
    if feature.kind != "plane":
        return float(np.ptp(along))
    return 2.0 * float(np.linalg.norm(offsets - along[:, None] * feature.axis, axis=1).max())


def _medians(feature: Feature, points: FloatArray) -> tuple[FloatArray, float]:
    """Points of the surface, each moved along the shape's own normal to the median of its neighbourhood."""
    from dqreg.inspection.features.models import Shape, distances

    plain = [0.0 if np.isnan(x) else x for x in (feature.radius, feature.half_angle)]
    shape = Shape(feature.point, feature.frame, *plain)
    offsets = distances(feature.kind, shape, points)[0][-len(points) :]
    medians, sigma = smoothed(offsets, points)
    return points + (medians - offsets)[:, None] * _outward(feature, points), sigma


def _outward(feature: Feature, points: FloatArray) -> FloatArray:
    if feature.kind == "plane":
        return np.broadcast_to(feature.axis, points.shape)
    offsets = points - feature.point
    if feature.kind != "sphere":
        offsets = offsets - (offsets @ feature.axis)[:, None] * feature.axis
    outward: FloatArray = offsets / np.maximum(np.linalg.norm(offsets, axis=1), 1e-300)[:, None]
    return outward
