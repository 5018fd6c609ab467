"""A plan carried out on a registered scan: features, datum alignment, characteristics, decisions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.decision.coverage import FaceCoverage
from dqreg.inspection.decision.decision import Decision, decide, require_held, worst_of
from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.measure import deviations_under
from dqreg.inspection.drawing.characteristics import Measured
from dqreg.inspection.plan.characteristics import UNDER, PlannedCharacteristic
from dqreg.inspection.plan.file import Plan
from dqreg.inspection.scanned_part.scanned_part import ScannedPart
from dqreg.inspection.scanned_part.sections import Section, section_on
from dqreg.inspection.sheet.aligned_part import AlignedPart, AlignedStep, Alignment, aligned_part, entry
from dqreg.inspection.sheet.measured_values import faces_of_row, measured_value, nominal_value
from dqreg.inspection.sheet.sheet_rows import (
    Characteristic,
    limits_of,
    outcome_of,
    refused_characteristic,
    refused_row,
)
from dqreg.inspection.tolerances import REQUIRED_SHARE, Tolerance, limits_at


@dataclasses.dataclass(frozen=True, eq=False)
class Inspection:
    """A plan carried out.

    Attributes
    ----------
    outcome : {"pass", "fail", "undecided"}
        The worst of the characteristics and of the decision on the deviations.
    characteristics : tuple of Characteristic
        In the order of the plan.
    alignment : DatumAlignment, PointAlignment, SurfaceAlignment or None
        The last step in the caller's target frame, from the registered scan; None for the best fit.
    plan : Plan
        What was asked.
    faces : tuple of FaceCoverage
        How much of every face of the part was scanned.
    steps : tuple of AlignedStep
        Alignments that followed each other, by name; none for the best fit.
    sections : tuple of (str, Section)
        Cuts of the plan, by name.
    decision : Decision or None
        On the deviations, where the plan gives them a tolerance.
    deviations : Deviations or None
        Under the alignment of the plan.
    """

    outcome: Outcome
    characteristics: tuple[Characteristic, ...]
    alignment: Alignment | None
    plan: Plan
    faces: tuple[FaceCoverage, ...] = ()
    steps: tuple[AlignedStep, ...] = ()
    sections: tuple[tuple[str, Section], ...] = ()
    decision: Decision | None = None
    deviations: Deviations | None = None


def inspect(deviations: Deviations, plan: Plan) -> Inspection:
    r"""Carry out a plan on a registered scan.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh.
    plan : Plan
        From `read_plan`.

    Returns
    -------
    Inspection
        A value, an uncertainty and a decision for every characteristic; one that could not be measured, or is not of
        this part, is undecided and says why. So do rows of the kinds alignment, face and section, which stand last, of
        an alignment that this scan does not hold and of entries that are not of this part.

    Raises
    ------
    InputError
        If the target is no mesh, an alignment or a datum names a face that the part has not, or nothing that the plan
        asks for is of this part.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from dqreg.geometry import Mesh, MeshSurface
    >>> from dqreg.inspection import measure_deviations, read_plan
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> scan = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * [1, 1, 0] + [0, 0, 1.02]
    >>> rows = '[[characteristic]]\nname = "top"\nkind = "form"\nnear = [0, 0, 1]\ntolerance = 0.01\n'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "plan.toml").write_text("tolerance = 0.05\n" + rows)
    ...     plan = read_plan(f"{folder}/plan.toml")
    >>> found = inspect(measure_deviations(scan, part, MeshSurface(part)), plan)
    >>> found.characteristics[0].outcome, found.decision.outcome
    ('pass', 'pass')
    """
    aligned = aligned_part(deviations, plan)
    part, refused, errors = aligned.part, _refused_alignment(plan, aligned), list[InputError]()
    laid = _laid(deviations, aligned)
    own = _own_tolerances(laid, part, plan, refused, errors)
    decision = None
    if not aligned.missing and (plan.tolerance is not None or own):
        laid, decision = _judged(laid, part, plan, own)
    rows = [_characteristic(aligned, plan, row, errors, scaled=deviations.scale_solved) for row in plan.characteristics]
    if decision is None and errors and len(errors) == len(rows) + len(plan.face_tolerances):
        raise errors[0]
    cuts = _sections(aligned, plan, refused)
    rows += refused
    outcomes: list[Outcome] = ["undecided"] if deviations.scale_solved else []
    outcomes += [row.outcome for row in rows] + ([decision.outcome] if decision else [])
    return Inspection(
        outcome=worst_of(outcomes),
        characteristics=tuple(rows),
        alignment=aligned.final,
        plan=plan,
        faces=_faces(part, plan, rows, own),
        steps=aligned.steps,
        sections=cuts,
        decision=decision,
        deviations=laid,
    )


def _refused_alignment(plan: Plan, aligned: AlignedPart) -> list[Characteristic]:
    """The alignment, where this scan does not hold it: nothing that is under it can pass."""
    if not aligned.missing:
        return []
    names = [step.name for step in plan.steps] or ["datums " + " | ".join(datum.name for datum in plan.datums)]
    return [refused_row(", then ".join(names), "alignment", aligned.missing)]


def _own_tolerances(
    deviations: Deviations, part: ScannedPart, plan: Plan, refused: list[Characteristic], errors: list[InputError]
) -> dict[int, Tolerance]:
    """Tolerances of single faces; an entry that cannot be held joins what is refused."""
    own: dict[int, Tolerance] = {}
    for row in plan.face_tolerances:
        try:
            with entry(row.where):
                require_held(deviations, row.tolerance)
                own |= {face.number: row.tolerance for face in part.named(row.faces)}
        except InputError as error:
            errors.append(error)
            refused.append(refused_row(row.where.rpartition(": ")[2], "face", error))
    return own


def _laid(deviations: Deviations, aligned: AlignedPart) -> Deviations:
    """Deviations under the alignment of the plan."""
    final = aligned.final
    if final is None:
        return deviations
    return deviations_under(deviations, final.T_target_source, final.covariance, final.centre)


def _judged(
    deviations: Deviations, part: ScannedPart, plan: Plan, own: dict[int, Tolerance]
) -> tuple[Deviations, Decision]:
    """Deviations with their tolerance, and the decision on them."""
    required = (plan.tolerance.required_share if plan.tolerance else None) or REQUIRED_SHARE
    decision = decide(deviations, plan.tolerance, required, own)
    limits = None
    if own or (plan.tolerance is not None and not plan.tolerance.equal):
        limits = limits_at(part.of_triangle[deviations.faces], plan.tolerance, own)
    return dataclasses.replace(deviations, tolerance=decision.tolerance, allowed=limits), decision


def _sections(aligned: AlignedPart, plan: Plan, refused: list[Characteristic]) -> tuple[tuple[str, Section], ...]:
    """The cuts of a plan; one that misses the part joins what is refused."""
    found = []
    for cut in plan.sections:
        try:
            aligned.require()
            found.append((cut.name, section_on(aligned.part, np.array(cut.point), np.array(cut.normal))))
        except (InputError, DegenerateGeometryError) as error:
            refused.append(refused_row(f"section {cut.name}", "section", error))
    return tuple(found)


def _faces(
    part: ScannedPart, plan: Plan, rows: Sequence[Characteristic], own: Collection[int]
) -> tuple[FaceCoverage, ...]:
    used = {number for row in rows for number in row.faces} | set(own)
    used |= {part.face(datum.face).number for datum in plan.datums}
    counts, shares = part.counts(), part.coverage()
    return tuple(
        FaceCoverage(f.number, f.kind, f.area, int(counts[f.number]), float(shares[f.number]), f.number in used)
        for f in part.faces
    )


def _characteristic(
    aligned: AlignedPart, plan: Plan, row: PlannedCharacteristic, errors: list[InputError], *, scaled: bool
) -> Characteristic:
    """A row of the drawing; one that is not of this part is refused by itself."""
    try:
        with entry(f"characteristic {row.name!r}"):
            return _measured(aligned, plan, row, scaled=scaled)
    except InputError as error:
        errors.append(error)
        return refused_characteristic(row, error)


def _measured(aligned: AlignedPart, plan: Plan, row: PlannedCharacteristic, *, scaled: bool) -> Characteristic:
    part, remark = aligned.part, ""
    faces = faces_of_row(part, plan, row)
    nominal = row.nominal if row.nominal is not None else nominal_value(part, row, faces)
    try:
        if row.kind in UNDER:
            aligned.require()
        found = measured_value(part, plan, row, faces, aligned.frame)
    except DegenerateGeometryError as error:
        # A face that the scanner did not see costs its own lines of the sheet only.
        found, remark = Measured(math.nan, math.nan), str(error)
    low, high = limits_of(row, nominal)
    shares = part.coverage()
    return Characteristic(
        name=row.name,
        kind=row.kind,
        faces=tuple(face.number for face in faces),
        nominal=nominal,
        low=low,
        high=high,
        value=found.value,
        uncertainty=found.uncertainty,
        outcome="undecided" if remark else outcome_of(row, found, nominal, scaled=scaled),
        points=sum(len(part.on(face)) for face in faces),
        coverage=min(float(shares[face.number]) for face in faces) if found.seen is None else found.seen,
        position=part.label(faces[0]) if found.place is None else part.labelled(found.place),
        remark=remark,
        fit=row.fit,
    )
