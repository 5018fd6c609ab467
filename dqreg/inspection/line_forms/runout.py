"""Runout of a face about the axis of a datum (ISO 1101): how far it moves under a dial as the part turns."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.inspection.decision.surface_model import Medians
from dqreg.inspection.drawing.characteristics import Measured, propagated
from dqreg.inspection.drawing.zones import from_nothing
from dqreg.inspection.features import Feature
from dqreg.inspection.features.starts import frame_along
from dqreg.inspection.line_forms.profiles import (
    Place,
    Profile,
    half_width,
    require_points,
    scanned_ones,
    spread_over,
    words_of,
)
from dqreg.inspection.line_forms.round_sections import DEFAULT_SECTIONS, require_round
from dqreg.inspection.line_forms.worst import block_count, worst_form
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.scanned_part import ScannedPart

# A face turns about an axis that it is parallel, or square, to by that sine, and beside by that share of its size.
MAX_LEANING_SIN, MAX_BESIDE_SHARE = 1e-3, 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class AboutAxis:
    """Points of a face about the axis of a datum: turn, height along it, distance from it, travel of a dial: (n,)."""

    turn: FloatArray
    height: FloatArray
    radius: FloatArray
    travel: FloatArray

    @classmethod
    def of(cls, points: FloatArray, ideal: Feature, base: Feature) -> AboutAxis:
        """The dial stands square to the nominal face: along the axis on a flat one, across it on a cylinder."""
        axis = base.axis if base.axis @ ideal.axis >= 0.0 else -base.axis
        local = (points - base.point) @ frame_along(axis)
        radius, height = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
        angle = {"plane": 0.5 * np.pi, "cone": ideal.half_angle}.get(ideal.kind, 0.0)
        travel = np.cos(angle) * radius - np.sin(angle) * height
        return cls(np.arctan2(local[:, 1], local[:, 0]), height, radius, travel)


def total_runout(part: ScannedPart, face: Face, datum: Face, base: Feature) -> Measured:
    """Travel of a dial over the whole face, about the axis of a datum as it was scanned."""
    ideal = _revolved(part, face, datum)
    part.require_scanned(face)
    points = part.on(face)
    travel = AboutAxis.of(points, ideal, base).travel
    require_round(face, AboutAxis.of(points, ideal, base).turn, "the face")
    medians = Medians.of(travel - np.median(travel), points, part.noise, to_rim=True)
    places, before = points[medians.rows], travel[medians.rows]

    def width(f: Sequence[Feature]) -> float:
        return float(np.ptp(medians.values + AboutAxis.of(places, ideal, f[0]).travel - before))

    value, room = medians.corrected(width([base]), lambda z: np.asarray(np.ptp(z, axis=-1)))
    return _about(Measured(value, room), propagated(width, [base]), base)


def circular_runout(part: ScannedPart, face: Face, datum: Face, base: Feature, at: Sequence[Place]) -> Measured:
    """Travel of a dial in one turn, in the worst of sections about the axis of a datum, or in those at places."""
    ideal = _revolved(part, face, datum)
    part.require_scanned(face)
    points = part.on(face)
    flat = AboutAxis.of(points, ideal, base)
    across = flat.radius if ideal.kind == "plane" else flat.height
    half = half_width(part, face, across)
    strips: list[IntArray] = []

    def section(middle: float, place: str = "") -> Profile:
        rows = np.flatnonzero(np.abs(across - middle) <= half)
        words = f"the section {f'at {place}' if place else f'{middle - float(across.min()):.4g} along the face'}"
        require_points(face, rows, words)
        require_round(face, flat.turn[rows], words)
        strips.append(rows)
        return _profile(flat, rows, across[rows] - middle, points)

    if at:
        where = [(_across_of(part, place, ideal, base, across), words_of(place)) for place in at]
        profiles = [section(*each) for each in where]
    else:
        profiles = scanned_ones(section, spread_over(across, half, DEFAULT_SECTIONS))
    turned = [each.blocks(block_count(len(each.values))).values for each in profiles]

    def width(f: Sequence[Feature]) -> float:
        moved = AboutAxis.of(points, ideal, f[0]).travel - flat.travel
        steps = (
            dataclasses.replace(each, values=moved[rows]).blocks(len(values)).values
            for each, rows, values in zip(profiles, strips, turned, strict=True)
        )
        return max(float(np.ptp(values + step)) for values, step in zip(turned, steps, strict=True))

    return _about(worst_form(profiles, part.noise), propagated(width, [base]), base)


def _profile(flat: AboutAxis, rows: IntArray, beside: FloatArray, points: FloatArray) -> Profile:
    """Travel round a strip without what it changes across the strip, which is of the whole face."""
    turn, travel = flat.turn[rows], flat.travel[rows]
    slopes = np.column_stack([beside, np.ones(len(rows)), np.cos(turn), np.sin(turn)])
    lean = np.linalg.lstsq(slopes, travel - np.median(travel), rcond=None)[0][0]
    values = travel - lean * beside
    radius = float(np.median(flat.radius[rows]))
    return Profile(turn, values - float(np.median(values)), radius, points[rows].mean(axis=0), held=True)


def _across_of(part: ScannedPart, place: Place, ideal: Feature, base: Feature, across: FloatArray) -> float:
    """Height along the axis, or on a flat face the distance from it, of a place that a plan names."""
    found = AboutAxis.of((np.array(place) - part.origin)[None], ideal, base)
    value = float((found.radius if ideal.kind == "plane" else found.height)[0])
    if not across.min() <= value <= across.max():
        beyond = max(float(across.min()) - value, value - float(across.max()))
        raise InputError(f"at = {words_of(place)} lies {beyond:.4g} beyond what was scanned of the face")
    return value


def _revolved(part: ScannedPart, face: Face, datum: Face) -> Feature:
    """The nominal face, which must turn into itself about the datum's nominal axis."""
    ideal, axis = part.ideal(face), part.ideal(datum)
    if axis.kind not in ("cylinder", "cone"):
        raise InputError(f"runout is about the axis of a cylinder or cone; the datum is a {axis.kind}")
    if ideal.kind not in ("cylinder", "cone", "plane"):
        raise InputError(f"runout is of cylinders, cones and flat faces square to the axis; face {face.number} is a "
                         f"{ideal.kind}")  # fmt: skip
    leaning = float(np.linalg.norm(np.cross(ideal.axis, axis.axis)))
    offset = ideal.point - axis.point
    beside = float(np.linalg.norm(offset - (offset @ axis.axis) * axis.axis))
    if leaning > MAX_LEANING_SIN or (ideal.kind != "plane" and beside > MAX_BESIDE_SHARE * face.extent):
        raise InputError(f"face {face.number} does not turn about the axis of the datum, so it has no runout to it")
    return ideal


def _about(own: Measured, of_axis: Measured, base: Feature) -> Measured:
    """A width with what the datum's axis adds to its uncertainty."""
    found = Measured(own.value, math.hypot(own.uncertainty, of_axis.uncertainty))
    return dataclasses.replace(from_nothing(found, base.freedom), place=own.place)
