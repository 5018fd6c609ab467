"""Sections across the axis of a scanned cylinder or cone, or through the centre of a sphere: for its roundness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry.angles import gaps_around
from dqreg.inspection.features import Feature
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.starts import frame_along
from dqreg.inspection.line_forms.profiles import (
    Place,
    Profile,
    Unrolled,
    half_width,
    require_kind,
    require_points,
    scanned_ones,
    spread_over,
    unrolled,
    words_of,
)
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.scanned_part import ScannedPart

# Sections where none is named.
DEFAULT_SECTIONS = 5
# Sections that an axis is found from.
MAX_AXIS_SECTIONS, MIN_AXIS_SECTIONS = 30, 3
# Points farther from the circle of their section than so many medians are outliers.
OUTLIER_MEDIANS, CUT_ROUNDS = 5.0, 3
# Share of the way round that must be seen: on less, form error is taken for another size and place, and no residual
# shows it. Bores with three lobes of 0.04 seen on 60 to 150 degrees had diameters off by ten uncertainties.
MIN_ARC_SHARE = 0.5


def sections_of(part: ScannedPart, face: Face, at: Sequence[Place], direction: Place | None) -> list[Profile]:
    """Sections through places, else spread along the axis; of a sphere across a direction, else three."""
    feature = part.measured(face)
    words = "has no round section across an axis; roundness is of cylinders, cones and spheres"
    require_kind(feature, ("cylinder", "cone", "sphere"), words)
    if feature.kind == "sphere":
        if at:
            raise InputError(
                "a section of a sphere goes through its centre: give direction, its normal, in place of at"
            )
        axes = np.eye(3) if direction is None else np.array([direction])
        return scanned_ones(lambda axis: _great_circle(part, face, axis), axes)
    if direction is not None:
        raise InputError(f"a section of a {feature.kind} lies across its axis: direction is of spheres")
    flat = unrolled(part, face)
    half = half_width(part, face, flat.height)
    if not at:
        every = spread_over(flat.height, half, DEFAULT_SECTIONS)
        return scanned_ones(lambda height: _section(face, flat, height, half), every)
    return [_section(face, flat, _height(part, flat, place), half, words_of(place)) for place in at]


def centres_of(part: ScannedPart, face: Face) -> tuple[FloatArray, FloatArray]:
    """Centres of sections of a cylinder (its derived median line, ISO 17450) and their covariances across the axis.

    Shapes: (k, 3), across the fitted axis and along it, and (k, 2, 2).
    """
    require_kind(part.measured(face), ("cylinder",), "has no axis that is found section by section; cylinders have")
    flat = unrolled(part, face)
    half = half_width(part, face, flat.height)
    middles = spread_over(flat.height, half, MAX_AXIS_SECTIONS)
    sections = scanned_ones(lambda height: _section(face, flat, height, half), middles)
    if len(sections) < MIN_AXIS_SECTIONS:
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned well enough: {len(sections)} sections across its axis hold a centre, "
            f"{MIN_AXIS_SECTIONS} are needed"
        )
    found = [_centre(section, part.noise) for section in sections]
    heights = [float((each.middle - flat.feature.point) @ flat.feature.axis) for each in sections]
    return np.column_stack([[centre for centre, _ in found], heights]), np.array([spread for _, spread in found])


def _height(part: ScannedPart, flat: Unrolled, place: Place) -> float:
    """Of a place along the axis."""
    (low, high), feature = flat.ends, flat.feature
    height = float((np.array(place) - part.origin - feature.point) @ feature.axis)
    if not low <= height <= high:
        beyond = max(low - height, height - high)
        raise InputError(f"at = {words_of(place)} lies {beyond:.4g} beyond the end of the face, along its axis")
    return height


def _section(face: Face, flat: Unrolled, height: float, half: float, place: str = "") -> Profile:
    rows = np.flatnonzero(np.abs(flat.height - height) <= half)
    words = f"the section {f'at {place}' if place else f'{height - flat.ends[0]:.4g} along its axis'}"
    require_points(face, rows, words)
    require_round(face, flat.turn[rows], words)
    slope = np.tan(flat.feature.half_angle) if flat.feature.kind == "cone" else 0.0
    middle = flat.feature.point + height * flat.feature.axis
    return Profile(flat.turn[rows], flat.values[rows], float(flat.feature.radius + slope * height), middle)


def _great_circle(part: ScannedPart, face: Face, axis: FloatArray) -> Profile:
    feature, points = part.measured(face), part.on(face)
    local = (points - feature.point) @ frame_along(axis)
    rows = np.flatnonzero(np.abs(local[:, 2]) <= half_width(part, face, local[:, 2]))
    words = f"the section across {words_of(axis)}"
    require_points(face, rows, words)
    turn = np.arctan2(local[rows, 1], local[rows, 0])
    require_round(face, turn, words)
    values = distances("sphere", feature.shape, points[rows])[0]
    return Profile(turn, values, feature.radius, feature.point)


def require_round(face: Face, turn: FloatArray, words: str) -> None:
    """`DegenerateGeometryError` where a section was scanned on less than half of a turn: its centre is not held."""
    seen = _round_deg(turn)
    if seen < 180.0:
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned well enough: {words} is seen on {seen:.0f} of 360 "
            "degrees, and more than half of them are needed"
        )


def require_around(part: ScannedPart, face: Face, kind: str) -> None:
    """`DegenerateGeometryError` where a round face was scanned on too little of its way round."""
    if face.feature is None or face.feature.kind not in ("cylinder", "cone"):
        return
    own = _arc_deg(part.corners([face]), face.feature)
    seen = _arc_deg(part.on(face), face.feature)
    if seen < MIN_ARC_SHARE * own:
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned well enough: it is seen on {seen:.0f} of {own:.0f} degrees round its "
            f"axis, and at least half of them are needed for its {kind}: form error would be taken for size"
        )


def _arc_deg(points: FloatArray, feature: Feature) -> float:
    local = (points - feature.point) @ feature.frame
    return _round_deg(np.arctan2(local[:, 1], local[:, 0]))


def _round_deg(turn: FloatArray) -> float:
    """Degrees that angles cover: a whole turn without the largest gap between them."""
    return 360.0 - float(np.degrees(gaps_around(turn)[1].max()))


def _centre(section: Profile, noise: float) -> tuple[FloatArray, FloatArray]:
    """Of the least squares circle of a section without outliers, and its covariance. Shapes: (2,), (2, 2)."""
    slopes, kept = section.slopes, np.ones(len(section.values), dtype=bool)
    for _ in range(CUT_ROUNDS):
        inverse = np.asarray(np.linalg.pinv(slopes[kept]), dtype=np.float64)
        solved = inverse @ section.values[kept]
        left = np.abs(section.values - slopes @ solved)
        kept = left <= OUTLIER_MEDIANS * float(np.median(left))
    return solved[1:], noise**2 * (inverse @ inverse.T)[1:, 1:]
