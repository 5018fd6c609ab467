"""Characteristics of a drawing: sizes, angles, form, profile; each with uncertainty. Others are `zones`, `distances`.

Every value is a function of measured features (and, for zones, of points); its uncertainty follows from the features'
covariances and that of the frame, one parameter at a time. Decisions are those of ISO 14253-1: pass or fail is proven,
or neither is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.decision.surface_model import Medians
from dqreg.inspection.features import Feature
from dqreg.inspection.features.feature import NUDGE_SIGMAS
from dqreg.inspection.features.fit import zone_width
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.spread import normals_of
from dqreg.rigid import pose, twist

# Directions whose cosine is less are at right angles on the part itself.
PERPENDICULAR_COS = 1e-5


@dataclasses.dataclass(frozen=True)
class Measured:
    """A value with its uncertainty: a length, or an angle in degrees."""

    value: float
    uncertainty: float  # Expanded, k = 2, in the same unit
    place: FloatArray | None = None  # Where on the feature, (3,); None: of all of it
    seen: float | None = None  # Share of its line that was scanned; None: of its faces

    def decide(self, low: float, high: float) -> Outcome:
        """Whether the value is proven to lie within its limits; undecided where one is within the uncertainty."""
        if self.value - self.uncertainty >= low and self.value + self.uncertainty <= high:
            return "pass"
        if self.value + self.uncertainty < low or self.value - self.uncertainty > high:
            return "fail"
        return "undecided"


@dataclasses.dataclass(frozen=True, eq=False)
class KnownFrame:
    """How well the frame is known that positions and profiles are measured in."""

    covariance: FloatArray  # (6, 6): Of a left increment about the centre, rotation first
    centre: FloatArray  # (3,)

    def sigma(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Standard deviation of deviations along normals that the frame gives them. Shapes: (n, 3), (n, 3)."""
        arms = np.hstack([np.cross(points - self.centre, normals), normals])
        return np.asarray(np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", arms, self.covariance, arms), 0.0)))


Value = Callable[[Sequence[Feature]], float]


def propagated(value: Value, features: Sequence[Feature], frame: KnownFrame | None = None) -> Measured:
    """A function of features with the uncertainty that follows from their covariances, to first order.

    Where few points leave the covariance itself uncertain, it is wider as Student's distribution is.
    """
    found, total = value(features), 0.0
    for k, feature in enumerate(features):
        for step in _steps(feature.covariance):
            changed = value([*features[:k], feature.nudged(step), *features[k + 1 :]])
            total += ((changed - found) / NUDGE_SIGMAS) ** 2
    if frame is not None:
        for step in _steps(frame.covariance):
            T = pose.about(twist.exp(step), frame.centre)
            total += ((value([feature.moved(T) for feature in features]) - found) / NUDGE_SIGMAS) ** 2
    return Measured(found, coverage_of(min(feature.freedom for feature in features)) * math.sqrt(total))


def _steps(covariance: FloatArray) -> list[FloatArray]:
    variances, vectors = np.linalg.eigh(covariance)
    return [NUDGE_SIGMAS * math.sqrt(float(s)) * v for s, v in zip(variances, vectors.T, strict=True) if s > 0.0]


def coverage_of(freedom: int) -> float:
    """Factor of the expanded uncertainty: 2, or as much more as few degrees of freedom ask (GUM, G.3).

    >>> round(coverage_of(1000), 2), round(coverage_of(4), 2)
    (2.0, 2.87)
    """
    from scipy.special import ndtr, stdtrit

    return float(stdtrit(max(freedom, 1), ndtr(COVERAGE_FACTOR)))


def diameter(feature: Feature) -> Measured:
    """Diameter of a circle, cylinder or sphere."""
    if feature.kind not in ("circle", "cylinder", "sphere"):
        raise InputError(f"a {feature.kind} has no diameter; circles, cylinders and spheres have")
    return propagated(lambda f: f[0].diameter, [feature])


def width(feature: Feature) -> Measured:
    """Width of a slot, across its flat sides."""
    return propagated(lambda f: f[0].width, [feature])


def length(feature: Feature) -> Measured:
    """Length of a slot, over its round ends."""
    return propagated(lambda f: f[0].length, [feature])


def angle(first: Feature, second: Feature, nominal_deg: float = 0.0, ideal: Sequence[Feature] = ()) -> Measured:
    """Angle between the normals or axes of two features, 0 to 90 degrees; a plane and an axis by the plane itself.

    Where it is nominally more than 90 degrees it is the supplement of that. ``ideal`` are both features on the part:
    one that is not at right angles there is followed beyond a right angle.
    """
    require_directions(first, second)
    along = float(ideal[0].axis @ ideal[1].axis) if ideal else 0.0
    side = math.copysign(1.0, along) if abs(along) > PERPENDICULAR_COS else 0.0

    def value(f: Sequence[Feature]) -> float:
        found = angle_deg(f[0], f[1], side)
        return 180.0 - found if nominal_deg > 90.0 else found

    return propagated(value, [first, second])


def form(feature: Feature, points: FloatArray, noise: float) -> Measured:
    """Flatness, straightness, roundness or cylindricity: the width of the zone that holds the surface.

    Of medians of neighbouring points, which single points do not move; without what noise adds to the zone, which is
    simulated, see `Medians.corrected`.
    """
    offsets, slopes = distances(feature.kind, feature.shape, points)
    offsets, slopes = offsets[-len(points) :], slopes[-len(points) :]
    medians = Medians.of(offsets, points, noise, to_rim=True)
    # Each place moves along the shape's own normal.
    outward = normals_of(feature.kind, feature.shape, points[medians.rows])
    places = points[medians.rows] + (medians.values - offsets[medians.rows])[:, None] * outward
    zone = zone_width(places, feature.kind)
    own = slopes[medians.rows]
    inverse = np.linalg.pinv(own)
    # A least squares shape follows each draw; the minimum zone is narrower than its zone by about the same share.
    width = float(np.ptp(medians.values - own @ (inverse @ medians.values)))
    share = zone / width if width > 0.0 else 1.0
    value, room = medians.corrected(zone, lambda z: share * np.ptp(z - z @ inverse.T @ own.T, axis=1))
    # The shape follows its points: of ten, a cylinder takes half of their form error for its size and place.
    taken = np.linalg.matrix_rank(own)
    return Measured(value, room + zone * taken / max(len(own) - taken, 1))


def profile(
    deviations: FloatArray, points: FloatArray, noise: float, *, frame_sigma: float = 0.0, middle: float = 0.0
) -> Measured:
    """Profile of a surface: twice the largest distance of medians of neighbouring points from the zone's middle.

    ``middle`` is that of a unilateral or unequal zone, signed, outside the part positive. Noise is treated as in
    `form`. Shapes: (n,), (n, 3).
    """
    medians = Medians.of(deviations, points, noise, to_rim=True)
    largest = 2.0 * float(np.abs(medians.values - middle).max())
    value, spread = medians.corrected(largest, lambda z: 2.0 * np.abs(z - middle).max(axis=1), 2.0)
    return Measured(value, math.hypot(spread, 2.0 * COVERAGE_FACTOR * frame_sigma))


def require_directions(*features: Feature) -> None:
    """`InputError` where one has no direction."""
    if any(feature.kind == "sphere" for feature in features):
        raise InputError("a sphere has no direction, so no angle")


def across(point: FloatArray, feature: Feature) -> float:
    """Distance of a point from an axis or a centre."""
    offset = point - feature.point
    if feature.kind == "sphere":
        return float(np.linalg.norm(offset))
    return float(np.linalg.norm(offset - (offset @ feature.axis) * feature.axis))


def angle_deg(a: Feature, b: Feature, side: float = 0.0) -> float:
    """Angle of two features, 0 to 90 degrees; beyond a right angle where ``side`` is the sign that its cosine had."""
    cosine = float(a.axis @ b.axis)
    across_both = float(np.linalg.norm(np.cross(a.axis, b.axis)))
    between = math.degrees(math.atan2(across_both, side * cosine if side else abs(cosine)))
    return 90.0 - between if (a.kind == "plane") != (b.kind == "plane") else between
