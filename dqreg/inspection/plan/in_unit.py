"""A plan in another length unit: the same demands, each length multiplied; angles, shares and directions stay."""

from __future__ import annotations

import dataclasses

from dqreg.files.units import factor
from dqreg.inspection.plan.alignment import PlannedStep
from dqreg.inspection.plan.characteristics import PlannedCharacteristic
from dqreg.inspection.plan.file import Plan
from dqreg.inspection.plan.keys import FaceName
from dqreg.inspection.tolerances import Tolerance

Triple = tuple[float, float, float]


def plan_in(plan: Plan, unit: str | None) -> Plan:
    """The plan in a unit; unchanged where one of the two is not known."""
    if plan.units is None or unit is None or plan.units == unit:
        return plan
    k = factor(plan.units, unit)
    return dataclasses.replace(
        plan,
        datums=tuple(dataclasses.replace(datum, face=_face(datum.face, k)) for datum in plan.datums),
        characteristics=tuple(_characteristic(row, k) for row in plan.characteristics),
        units=unit,
        steps=tuple(_step(step, k) for step in plan.steps),
        sections=tuple(dataclasses.replace(cut, point=_place(cut.point, k)) for cut in plan.sections),
        tolerance=None if plan.tolerance is None else _tolerance(plan.tolerance, k),
        face_tolerances=tuple(
            dataclasses.replace(own, faces=_faces(own.faces, k), tolerance=_tolerance(own.tolerance, k))
            for own in plan.face_tolerances
        ),
        expected_deviation=None if plan.expected_deviation is None else k * plan.expected_deviation,
    )


def _characteristic(row: PlannedCharacteristic, k: float) -> PlannedCharacteristic:
    # Limits of an angle are degrees; that of an angularity is the width of a zone.
    by = 1.0 if row.kind == "angle" else k
    return dataclasses.replace(
        row,
        faces=_faces(row.faces, k),
        nominal=None if row.nominal is None else by * row.nominal,
        plus=by * row.plus,
        minus=by * row.minus,
        middle=by * row.middle,
        point=None if row.point is None else _place(row.point, k),
        line=dataclasses.replace(row.line, at=tuple(_place(place, k) for place in row.line.at)),
    )


def _step(step: PlannedStep, k: float) -> PlannedStep:
    prior = step.prior
    return dataclasses.replace(
        step,
        faces=_faces(step.faces, k),
        band=None if step.band is None else (k * step.band[0], k * step.band[1]),
        # A place, and after it the direction that it counts along.
        points=tuple((*_place((point[0], point[1], point[2]), k), *point[3:]) for point in step.points),
        prior=None if prior is None else dataclasses.replace(prior, translation=_place(prior.translation, k)),
    )


def _tolerance(given: Tolerance, k: float) -> Tolerance:
    return dataclasses.replace(given, low=k * given.low, high=k * given.high)


def _faces(faces: tuple[FaceName, ...], k: float) -> tuple[FaceName, ...]:
    return tuple(_face(face, k) for face in faces)


def _face(face: FaceName, k: float) -> FaceName:
    return face if isinstance(face, int) else tuple(k * x for x in face)


def _place(place: Triple, k: float) -> Triple:
    return k * place[0], k * place[1], k * place[2]
