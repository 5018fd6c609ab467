"""The value of each kind of characteristic on a scanned part, and what it is on the part itself."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.deviations.outward_side import require_sides
from dqreg.inspection.drawing import characteristics as compute
from dqreg.inspection.drawing import zones
from dqreg.inspection.drawing.characteristics import KnownFrame, Measured
from dqreg.inspection.drawing.distances import distance
from dqreg.inspection.drawing.zones import FaceScan
from dqreg.inspection.features import Feature
from dqreg.inspection.line_forms.line_profile import faces_cut, line_profile
from dqreg.inspection.line_forms.round_sections import centres_of, require_around, sections_of
from dqreg.inspection.line_forms.runout import circular_runout, total_runout
from dqreg.inspection.line_forms.straight_lines import lines_of
from dqreg.inspection.line_forms.worst import axis_form, worst_form
from dqreg.inspection.part_faces import Face
from dqreg.inspection.plan.characteristics import OF_SLOT, PROFILES, RUNOUT, PlannedCharacteristic
from dqreg.inspection.plan.file import Plan
from dqreg.inspection.scanned_part.edge_points import edge_beside, edge_on
from dqreg.inspection.scanned_part.face_deviations import face_deviations
from dqreg.inspection.scanned_part.scanned_part import ScannedPart
from dqreg.inspection.scanned_part.sections import Section, section_on
from dqreg.inspection.scanned_part.thickness import wall_thickness

# Those that depend on the size or place of a round face, which form error changes where little of it was seen.
SIZED = ("diameter", "distance", "form", "position", "coaxiality")
# Points whose heights along an axis differ by no more than that do not hold its tilt against form.
MAX_FLAT_RADII = 0.2


def faces_of_row(part: ScannedPart, plan: Plan, row: PlannedCharacteristic) -> list[Face]:
    """The faces that a characteristic is of; of an edge point those that meet there, of a section those it cuts."""
    if row.point is not None:
        face = part.face(row.faces[0]).number if row.faces else None
        return [part.faces[number] for number in edge_beside(part, np.array(row.point) - part.origin, face).faces]
    if row.kind in OF_SLOT:
        return part.named(row.faces)
    if row.kind == "line-profile":
        return faces_cut(part, _section(part, plan, row), part.named(row.faces))
    faces = [part.face(name) for name in row.faces]
    if len({face.number for face in faces}) < len(faces):
        raise InputError(f"both faces are face {faces[0].number}: a {row.kind} is of two")
    return faces


def nominal_value(part: ScannedPart, row: PlannedCharacteristic, faces: list[Face]) -> float:
    """What a characteristic is on the part itself."""
    if row.kind == "diameter":
        nominal = compute.diameter(part.ideal(faces[0])).value
    elif row.kind == "distance":
        nominal = distance(part.ideal(faces[0]), part.ideal(faces[1]), _middle_of(faces)).value
    elif row.kind == "angle":
        nominal = compute.angle(part.ideal(faces[0]), part.ideal(faces[1])).value
    elif row.kind in ("width", "length"):
        ideal = part.ideal_slot(faces)
        nominal = ideal.width if row.kind == "width" else ideal.length
    elif row.kind == "thickness":
        try:
            nominal = wall_thickness(part, faces[0]).nominal(_middle_of_limits(row))
        except DegenerateGeometryError:
            # That it was not scanned is said where it is measured.
            nominal = float("nan")
    else:
        nominal = 0.0
    # A part's file holds single precision: more digits of its nominal values are noise.
    return float(f"{nominal:.6g}")


def measured_value(
    part: ScannedPart, plan: Plan, row: PlannedCharacteristic, faces: list[Face], frame: KnownFrame
) -> Measured:
    """The value of a characteristic, with its uncertainty."""
    points = part.on(faces[0])
    if row.point is not None:
        edge = edge_on(part, np.array(row.point) - part.origin, face=faces[0].number)
        spread = float(frame.sigma(edge.point[None], edge.outward[None])[0])
        return Measured(edge.offset, COVERAGE_FACTOR * float(np.hypot(edge.sigma, spread)))
    if row.kind in PROFILES:
        return _profile(part, plan, row, faces, frame)
    if row.kind == "thickness":
        part.require_scanned(faces[0])
        return wall_thickness(part, faces[0]).measured(_middle_of_limits(row), row.nominal)
    if row.kind in OF_SLOT:
        slot = part.measured_slot(faces)
        if row.kind == "slot-position":
            ideal = part.ideal_slot(faces)
            return zones.position(slot, ideal, _scan_of(part, faces, ideal), frame)
        return compute.width(slot) if row.kind == "width" else compute.length(slot)
    if row.kind in RUNOUT:
        return _runout(part, plan, row, faces[0])
    measured = [part.measured(face, row.fit) for face in faces]
    if row.kind in SIZED:
        for face in faces:
            require_around(part, face, row.kind)
    if row.kind == "diameter":
        return compute.diameter(measured[0])
    if row.kind == "distance":
        return distance(measured[0], measured[1], _middle_of(faces), [part.ideal(face) for face in faces])
    if row.kind == "angle":
        return compute.angle(measured[0], measured[1], row.nominal or 0.0, [part.ideal(face) for face in faces])
    if row.kind == "form":
        return _of_held_axis(compute.form(measured[0], points, part.noise), measured[0], part.ideal(faces[0]), points)
    if row.kind in ("roundness", "straightness"):
        return _line_form(part, row, faces[0])
    if row.kind == "position":
        ideal = part.ideal(faces[0])
        return zones.position(measured[0], ideal, _scan_of(part, faces, ideal), frame)
    named = next(datum for datum in plan.datums if datum.name == row.datum)
    return _to_datum(part, row, faces[0], part.face(named.face), part.measured(part.face(named.face), named.fit))


def _of_held_axis(form: Measured, feature: Feature, ideal: Feature, points: FloatArray) -> Measured:
    """A form with the two lobes that its axis may have followed: of points at one height the tilt takes them.

    A round face tilted by an angle is an ellipse across its own axis, whose zone is the radius times that squared.
    """
    height = float(np.ptp(points @ ideal.axis))
    if feature.kind not in ("cylinder", "cone") or height > MAX_FLAT_RADII * feature.radius:
        return form
    sine = float(np.linalg.norm(np.cross(feature.axis, ideal.axis)))
    return dataclasses.replace(form, uncertainty=form.uncertainty + feature.radius * sine**2)


def _middle_of_limits(row: PlannedCharacteristic) -> float:
    """Middle of the limits of a size, above its nominal value: the place that counts lies farthest from it."""
    return 0.5 * (row.plus - row.minus)


def _middle_of(faces: list[Face]) -> FloatArray:
    """Middle of some faces, (3,): as much nearer to a smaller one as that is smaller."""
    shares = 1.0 / np.array([face.area for face in faces])
    return np.asarray(shares @ np.array([face.centre for face in faces]) / shares.sum())


def _scan_of(part: ScannedPart, faces: list[Face], ideal: Feature) -> FaceScan:
    corners = part.corners(faces)
    if ideal.kind not in ("plane", "sphere"):
        # A tilted axis ends where the part's own does, not where the rim of the face does.
        along = (corners - ideal.point) @ ideal.axis
        corners = ideal.point + np.array([[along.min()], [along.max()]]) * ideal.axis
    return FaceScan(np.concatenate([part.on(face) for face in faces]), corners, part.noise)


def _to_datum(part: ScannedPart, row: PlannedCharacteristic, face: Face, datum: Face, base: Feature) -> Measured:
    """An orientation or a coaxiality, given the datum as it was scanned."""
    ideal = part.ideal(face)
    measured, scan = part.measured(face, row.fit), _scan_of(part, [face], ideal)
    if row.kind == "coaxiality":
        return zones.coaxiality(measured, base, scan)
    nominal = {"parallelism": 0.0, "perpendicularity": 90.0}.get(row.kind)
    return zones.orientation(
        measured, base, scan, compute.angle(ideal, part.ideal(datum)).value if nominal is None else nominal
    )


def _section(part: ScannedPart, plan: Plan, row: PlannedCharacteristic) -> Section:
    """The cut that a profile of a line is of."""
    named = next(cut for cut in plan.sections if cut.name == row.line.section)
    try:
        return section_on(part, np.array(named.point), np.array(named.normal))
    except DegenerateGeometryError as error:
        # It is not of this part, whatever was scanned.
        raise InputError(str(error)) from error


def _profile(
    part: ScannedPart, plan: Plan, row: PlannedCharacteristic, faces: list[Face], frame: KnownFrame
) -> Measured:
    """Profile of a face, or of a line in a section, under the alignment of the plan."""
    if row.middle:
        require_sides(part.mesh, "unequal sides of a tolerance")
    if row.kind == "line-profile":
        cut = _section(part, plan, row)
        return line_profile(part, row.line.section, cut, faces, middle=row.middle, frame=frame)
    part.require_scanned(faces[0])
    points = part.on(faces[0])
    signed, normals = face_deviations(part, faces[0], points)
    spread = float(frame.sigma(points, normals).max(initial=0.0))
    return compute.profile(signed, points, part.noise, frame_sigma=spread, middle=row.middle)


def _runout(part: ScannedPart, plan: Plan, row: PlannedCharacteristic, face: Face) -> Measured:
    """Circular or total runout about the axis of the datum as it was scanned."""
    named = next(datum for datum in plan.datums if datum.name == row.datum)
    datum = part.face(named.face)
    base = part.measured(datum, named.fit)
    if row.kind == "total-runout":
        return total_runout(part, face, datum, base)
    return circular_runout(part, face, datum, base, row.line.at)


def _line_form(part: ScannedPart, row: PlannedCharacteristic, face: Face) -> Measured:
    """Roundness or straightness, the worst of the profiles that are meant."""
    if row.line.of_axis:
        return axis_form(*centres_of(part, face))
    profiles = (sections_of if row.kind == "roundness" else lines_of)(part, face, row.line.at, row.line.direction)
    return worst_form(profiles, part.noise)
