"""Zones of position, orientation and coaxiality: the least about the ideal place or direction that holds a feature.

Of a plane the zone holds the surface, as medians of neighbouring points show it, and the fitted plane as far as its
face reaches (ISO 1101); of others it holds the fitted axis from one end of the face to the other, or the centre.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.decision.surface_model import Medians
from dqreg.inspection.drawing.characteristics import (
    KnownFrame,
    Measured,
    across,
    angle_deg,
    coverage_of,
    propagated,
    require_directions,
)
from dqreg.inspection.features import Feature
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.zone import chebyshev_step

# A zone at less than that angle to its datum turns about the datum's direction without changing, radians.
UPRIGHT_RAD = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class FaceScan:
    """The scan of a face, and how far the part's own face reaches."""

    points: FloatArray  # (n, 3): Of the scan
    corners: FloatArray  # (k, 3): Of the part's own flat face, which the scan may not reach; else the ends of its axis
    noise: float  # Standard deviation of a scan point


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """A flat face as it was scanned, and the corners of the part's own face."""

    feature: Feature
    medians: Medians  # Of the distances from the fitted plane
    corners: FloatArray  # (k, 3)

    @classmethod
    def of(cls, feature: Feature, scan: FaceScan) -> Surface:
        """The face from its scan and the plane that is fitted to it."""
        offsets = distances("plane", feature.shape, scan.points)[0]
        return cls(feature, Medians.of(offsets, scan.points, scan.noise, to_rim=True), scan.corners)

    def feet(self, plane: Feature) -> FloatArray:
        """Feet of the medians' places, then of the corners, on a plane beside the fitted one: (m + k, 3)."""
        places = np.vstack([self.medians.points[self.medians.rows], self.corners])
        return np.asarray(places - ((places - plane.point) @ plane.axis)[:, None] * plane.axis)

    def raised(self, values: FloatArray) -> FloatArray:
        """Distances from the plane at the same places: those given at the medians, 0 at the corners."""
        return np.concatenate([values, np.zeros((*values.shape[:-1], len(self.corners)))], axis=-1)


def position(feature: Feature, nominal: Feature, scan: FaceScan, frame: KnownFrame) -> Measured:
    """Diameter, or width, of the least zone about the nominal place that holds the feature over its face."""
    if nominal.kind == "plane":
        return _plane_position(Surface.of(feature, scan), nominal, frame)
    if feature.kind == "sphere":
        found = propagated(lambda f: 2.0 * across(f[0].point, nominal), [feature], frame)
        return from_nothing(found, feature.freedom)
    ends = _ends(feature, scan.corners)
    found = propagated(lambda f: _from_axis(f[0], nominal, ends), [feature], frame)
    return from_nothing(found, feature.freedom, len(ends))


def coaxiality(feature: Feature, datum: Feature, scan: FaceScan) -> Measured:
    """Diameter of the least cylinder about the datum's axis that holds the feature's axis over its face."""
    for each in (feature, datum):
        if each.kind not in ("line", "cylinder", "cone", "circle"):
            raise InputError(f"a {each.kind} has no axis; coaxiality is of cylinders, cones, circles and lines")
    ends = _ends(feature, scan.corners)
    found = propagated(lambda f: _from_axis(f[0], f[1], ends), [feature, datum])
    return from_nothing(found, min(feature.freedom, datum.freedom), len(ends))


def orientation(feature: Feature, datum: Feature, scan: FaceScan, nominal_deg: float | None = None) -> Measured:
    """Parallelism, perpendicularity or angularity: width of the zone in the ideal direction to the datum.

    The ideal angle is the nominal one, or of 0 and 90 degrees the nearer.
    """
    require_directions(feature, datum)
    ideal = nominal_deg
    if ideal is None:
        ideal = 0.0 if angle_deg(feature, datum) < 45.0 else 90.0
    if feature.kind == "plane":
        return _plane_orientation(Surface.of(feature, scan), datum, ideal)
    reach = float(np.ptp(scan.corners @ feature.axis))
    found = propagated(lambda f: reach * math.sin(math.radians(abs(angle_deg(f[0], f[1]) - ideal))), [feature, datum])
    return from_nothing(found, min(feature.freedom, datum.freedom))


def _ends(feature: Feature, corners: FloatArray) -> tuple[float, ...]:
    """Where the face ends along the feature's axis, from its point; a circle has no length."""
    along = (corners - feature.point) @ feature.axis
    return (float(along.min()), float(along.max())) if feature.kind != "circle" else (0.0,)


def _from_axis(feature: Feature, ideal: Feature, ends: Sequence[float]) -> float:
    return 2.0 * max(across(feature.point + end * feature.axis, ideal) for end in ends)


def _plane_position(surface: Surface, nominal: Feature, frame: KnownFrame) -> Measured:
    feature, values = surface.feature, surface.medians.values

    def heights(plane: Feature, raised: FloatArray) -> FloatArray:
        flat = (surface.feet(plane) - nominal.point) @ nominal.axis
        return np.asarray(flat + float(plane.axis @ nominal.axis) * surface.raised(raised))

    def width(f: Sequence[Feature]) -> float:
        return 2.0 * float(np.abs(heights(f[0], values)).max())

    shape = propagated(width, [feature], frame)
    own = surface.medians.corrected(shape.value, lambda z: 2.0 * np.abs(heights(feature, z)).max(axis=-1), 2.0)
    return Measured(own[0], math.hypot(own[1], shape.uncertainty))


def _plane_orientation(surface: Surface, datum: Feature, ideal_deg: float) -> Measured:
    feature, medians = surface.feature, surface.medians
    # From the normal to the datum's direction; a plane and an axis are at 90 degrees less that.
    between = math.radians(ideal_deg if datum.kind == "plane" else 90.0 - ideal_deg)

    def zone(f: Sequence[Feature]) -> tuple[FloatArray, FloatArray | None]:
        """Heights of the plane in the ideal direction, and how they change as that turns about the datum's."""
        plane, base = f
        toward = base.axis if base.axis @ plane.axis >= 0.0 else -base.axis
        feet = surface.feet(plane) - plane.point
        if between < UPRIGHT_RAD:
            return np.asarray(feet @ toward), None
        beside = plane.axis - (plane.axis @ toward) * toward
        ideal = math.cos(between) * toward + math.sin(between) * beside / np.linalg.norm(beside)
        return np.asarray(feet @ ideal), np.asarray(feet @ np.cross(toward, ideal))

    def width(f: Sequence[Feature]) -> float:
        flat, turning = zone(f)
        return _least_width(flat + surface.raised(medians.values), turning)

    shape = propagated(width, [feature, datum])
    flat, turning = zone([feature, datum])
    slopes = np.ones((len(flat), 1)) if turning is None else np.column_stack([turning, np.ones(len(flat))])
    inner = slopes[: len(medians.values)]
    inverse = np.linalg.pinv(inner)

    def simple(z: FloatArray) -> FloatArray:
        # The least zone turns with each draw; a least squares one is wider by about the same share.
        turned = (flat[: len(inner)] + z) @ inverse.T @ slopes.T
        return np.asarray(np.ptp(flat + surface.raised(z) - turned, axis=-1))

    plain = float(simple(medians.values))
    share = shape.value / plain if plain > 0.0 else 1.0
    value, spread = medians.corrected(shape.value, lambda z: share * simple(z))
    found = Measured(value, math.hypot(spread, shape.uncertainty))
    return from_nothing(found, min(feature.freedom, datum.freedom))


def _least_width(heights: FloatArray, turning: FloatArray | None) -> float:
    """Width of the zone of heights, the least where it may turn by a small angle. Shapes: (n,), (n,)."""
    width = float(np.ptp(heights))
    reach = 0.0 if turning is None else float(np.ptp(turning))
    if turning is None or width == 0.0 or reach == 0.0:
        return width
    z = (heights - heights.min()) / width - 0.5
    slopes = np.column_stack([(turning - turning.mean()) / reach, np.ones(len(z))])
    step = chebyshev_step(np.concatenate([z, -z]), np.vstack([slopes, -slopes]), 2.0)
    return width * min(float(np.ptp(z + slopes @ step)), 1.0)


def from_nothing(found: Measured, freedom: int, ends: int = 1) -> Measured:
    """Near zero a length has one side only, and two directions of which its slope shows one; so has the other end."""
    from scipy.special import fdtri, ndtr

    # A length in two directions is below that many standard deviations as often as one value is below its coverage.
    share = (2.0 * float(ndtr(COVERAGE_FACTOR)) - 1.0) ** (1.0 / ends)
    wide = math.sqrt(2.0 * float(fdtri(2, freedom, share))) / coverage_of(freedom) * found.uncertainty
    return Measured(found.value, max(found.uncertainty, min(wide, found.value)))
