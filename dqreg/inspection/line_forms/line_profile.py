"""Profile of a line (ISO 1101): how far the outline of a face lies from its nominal one in a section."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.decision.surface_model import sigma_of
from dqreg.inspection.drawing.characteristics import KnownFrame, Measured
from dqreg.inspection.drawing.random_field import Series, drawn_series
from dqreg.inspection.line_forms.profiles import half_width, require_points, scanned_ones
from dqreg.inspection.line_forms.worst import MAX_BLOCKS, MIN_BLOCK_POINTS
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.face_deviations import face_deviations
from dqreg.inspection.scanned_part.scanned_part import ScannedPart
from dqreg.inspection.scanned_part.sections import Section

# Share of the outline that must have been scanned.
MIN_LINE_SHARE = 0.5


def faces_cut(part: ScannedPart, cut: Section, chosen: Sequence[Face]) -> list[Face]:
    """The faces that a section cuts, those chosen or all; `InputError` where it cuts one of the chosen nowhere."""
    numbers = np.unique(_face_along(part, cut)).tolist()
    for face in chosen:
        if face.number not in numbers:
            raise InputError(f"the section does not cut face {face.number}; it cuts {', '.join(map(str, numbers))}")
    return list(chosen) or [part.faces[number] for number in numbers]


def line_profile(
    part: ScannedPart, name: str, cut: Section, faces: Sequence[Face], *, middle: float, frame: KnownFrame
) -> Measured:
    """Twice the largest distance of the outline from the middle of its zone, in the worst of the faces that are cut.

    Its outline is what a random field makes of medians of neighbouring points in a strip along the section; what was
    not scanned says nothing.
    """
    on = np.isin(_face_along(part, cut), [face.number for face in faces])
    seen = on & np.isfinite(cut.values)
    share = float(seen.sum() / on.sum())
    if share < MIN_LINE_SHARE:
        raise DegenerateGeometryError(
            f"section {name!r} was not scanned well enough: {100.0 * share:.0f} % of its outline has scan points, and "
            "at least half of it is needed"
        )
    found = scanned_ones(lambda face: _of_face(part, name, cut, face, middle, frame), faces)
    value = max(each.value for each in found)
    # The worst is as large as the largest lower end at least, and as the largest upper end at most.
    low, high = (max(each.value + sign * each.uncertainty for each in found) for sign in (-1.0, 1.0))
    worst = int(np.argmax(np.where(seen, np.abs(cut.values - middle), -1.0)))
    return Measured(value, max(high - value, value - low), cut.positions[worst] - part.origin, share)


def _of_face(part: ScannedPart, name: str, cut: Section, face: Face, middle: float, frame: KnownFrame) -> Measured:
    """Of one face: its points in the strip, laid into the plane of the section."""
    points = part.on(face)
    away = (points + part.origin - cut.point) @ cut.normal
    half = half_width(part, face, away) if len(away) else 0.0
    rows = np.flatnonzero(np.abs(away) <= half)
    require_points(face, rows, f"section {name!r}")
    signed, normals = face_deviations(part, face, points[rows])
    room = 2.0 * COVERAGE_FACTOR * float(frame.sigma(points[rows], normals).max(initial=0.0))
    if part.noise == 0.0:
        return Measured(2.0 * float(np.abs(signed - middle).max()), room)
    flat = points[rows] - away[rows, None] * cut.normal
    blocks = _blocks(part, cut, face, flat)
    places, values = (
        np.array([f(each[k], axis=0) for k in blocks]) for f, each in ((np.mean, flat), (np.median, signed))
    )
    sigma, level = sigma_of(part.noise, min(map(len, blocks))), float(values.mean())
    drawn = drawn_series([Series(places, values - level, np.ones((len(values), 1)), sigma)])
    # What is beside the level of the line is form error, which a random field explains.
    offset, own = 2.0 * abs(level - middle), level - middle + drawn.values[0]
    zones, zone = (2.0 * np.abs(each).max(axis=-1) - offset for each in (own, own.mean(axis=0)))
    value, form_room = drawn.measured(zones, float(zone))
    return Measured(offset + value, math.hypot(form_room, room, 2.0 * COVERAGE_FACTOR * sigma / math.sqrt(len(values))))


def _blocks(part: ScannedPart, cut: Section, face: Face, flat: FloatArray) -> list[IntArray]:
    """Neighbouring points along the outline of a face, which an opening parts."""
    own = np.flatnonzero(_face_along(part, cut) == face.number)
    places = cut.positions[own] - part.origin
    from scipy.spatial import cKDTree

    nearest = np.asarray(cKDTree(places).query(flat)[1])
    along = np.cross(cut.normal, cut.outward[own[nearest]])
    arc = cut.arc[own[nearest]] + np.einsum("ij,ij->i", flat - places[nearest], along)
    pieces = np.cumsum(np.diff(own, prepend=own[0]) > 1)[nearest]
    size = max(MIN_BLOCK_POINTS, -(-len(flat) // MAX_BLOCKS))
    found: list[IntArray] = []
    for piece in np.unique(pieces):
        rows = np.flatnonzero(pieces == piece)
        found += np.array_split(rows[np.argsort(arc[rows], kind="stable")], max(len(rows) // size, 1))
    return found


def _face_along(part: ScannedPart, cut: Section) -> IntArray:
    """Number of the face at each place of the outlines, (m,)."""
    return part.of_triangle[part.surface.closest(cut.positions - part.origin).elements]
