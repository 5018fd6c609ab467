"""Straight lines of a scanned face: generatrices of a cylinder or cone, lines of a flat face along a direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.features.models import distances
from dqreg.inspection.line_forms.profiles import (
    Place,
    Profile,
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

# Lines where none is named: around an axis, and beside each other on a flat face.
LINES_AROUND, LINES_BESIDE = 8, 5
# A direction along a face leads out of it by that sine at most.
MAX_LEANING_SIN = 0.5


def lines_of(part: ScannedPart, face: Face, at: Sequence[Place], direction: Place | None) -> list[Profile]:
    """Lines through places, else spread over the face."""
    feature = part.measured(face)
    if feature.kind == "plane":
        return _of_plane(part, face, at, direction)
    words = "has no straight lines; straightness is of planes, cylinders and cones"
    require_kind(feature, ("cylinder", "cone"), words)
    if direction is not None:
        raise InputError(f"the straight lines of a {feature.kind} lie in planes with its axis: direction is of planes")
    flat = unrolled(part, face)
    cosine = float(np.cos(feature.half_angle)) if feature.kind == "cone" else 1.0
    half = half_width(part, face, flat.turn * flat.radius)

    def line(turn: float, place: str = "") -> Profile:
        beside = np.abs(np.angle(np.exp(1j * (flat.turn - turn)))) * flat.radius
        rows = np.flatnonzero(beside <= half)
        require_points(face, rows, f"the line {f'at {place}' if place else f'{np.degrees(turn):.0f} degrees round'}")
        radius, height = float(np.median(flat.radius[rows])), float(np.median(flat.height[rows]))
        middle = feature.point + feature.frame @ [radius * np.cos(turn), radius * np.sin(turn), height]
        # Along the line itself and across it: that of a cone leans.
        return Profile(flat.height[rows] / cosine, flat.values[rows] * cosine, 0.0, middle)

    def turn_of(place: Place) -> float:
        x, y, _ = (np.array(place) - part.origin - feature.point) @ feature.frame
        if np.hypot(x, y) <= 0.5 * float(flat.radius.min()):
            raise InputError(f"at = {words_of(place)} is nearer to the axis than to the face: give a place on its line")
        return float(np.arctan2(y, x))

    if at:
        return [line(turn_of(place), words_of(place)) for place in at]
    return scanned_ones(line, [2.0 * np.pi * k / LINES_AROUND for k in range(LINES_AROUND)])


def _of_plane(part: ScannedPart, face: Face, at: Sequence[Place], direction: Place | None) -> list[Profile]:
    feature, points = part.measured(face), part.on(face)
    if direction is None:
        raise InputError("straightness of a flat face is along a direction: give direction = [x, y, z]")
    y = _across(feature.axis, np.array(direction))
    x = np.cross(y, feature.axis)
    across, along = (points - feature.point) @ y, (points - feature.point) @ x
    values = distances("plane", feature.shape, points)[0]
    half = half_width(part, face, across)
    corners = part.mesh.corners[part.of_triangle == face.number]

    def line(middle: float, place: str = "") -> Profile:
        rows = np.flatnonzero(np.abs(across - middle) <= half)
        require_points(face, rows, f"the line {f'at {place}' if place else f'{middle:+.4g} beside its middle'}")
        centre = feature.point + middle * y + float(np.median(along[rows])) * x
        local = (corners - feature.point) @ np.column_stack([y, x]) - [middle, 0.0]
        return Profile(along[rows], values[rows], 0.0, centre, stretches=_stretches(local))

    if at:
        return [line(float((np.array(place) - part.origin - feature.point) @ y), words_of(place)) for place in at]
    return scanned_ones(line, spread_over(across, half, LINES_BESIDE))


def _across(normal: FloatArray, direction: FloatArray) -> FloatArray:
    """Unit vector of a flat face across a direction along it, (3,)."""
    length = float(np.linalg.norm(direction))
    if length == 0.0 or abs(float(direction @ normal)) > MAX_LEANING_SIN * length:
        raise InputError(f"direction = {words_of(direction)} does not lie along the face: give one that does")
    across = np.cross(normal, direction)
    return np.asarray(across / np.linalg.norm(across))


def _stretches(corners: FloatArray) -> FloatArray:
    """Where the second axis meets triangles, (t, 3, 2), from each beginning to its end, (k, 2): a face has openings."""
    ends = np.roll(corners, -1, axis=1)
    crossed = (corners[..., 0] < 0.0) != (ends[..., 0] < 0.0)
    if not crossed.any():
        return np.zeros((0, 2))
    share = -corners[..., 0] / np.where(crossed, ends[..., 0] - corners[..., 0], 1.0)
    met = corners[..., 1] + share * (ends[..., 1] - corners[..., 1])
    low, high = np.where(crossed, met, np.inf).min(axis=1), np.where(crossed, met, -np.inf).max(axis=1)
    order = np.argsort(low, kind="stable")[: np.count_nonzero(crossed.any(axis=1))]
    low, reached = low[order], np.maximum.accumulate(high[order])
    # Triangles beside each other meet in one place, but for rounding.
    begins = np.diff(low, prepend=-np.inf) > 0.0
    begins[1:] &= low[1:] > reached[:-1] + 1e-9 * np.ptp(low)
    first = np.flatnonzero(begins)
    return np.column_stack([low[first], reached[np.r_[first[1:], len(low)] - 1]])
