"""A plan carried out on a registered scan: features, datum alignment, characteristics, decisions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.aligned_part import AlignedPart, AlignedStep, Alignment, aligned_part, entry
from dqreg.inspection.characteristics import KnownFrame, Measured
from dqreg.inspection.coverage import FaceCoverage
from dqreg.inspection.decision import Decision, decide, worst_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.measure import deviations_under
from dqreg.inspection.plan.characteristics import ZONES, PlannedCharacteristic
from dqreg.inspection.plan.file import Plan, PlannedSection
from dqreg.inspection.plan.measured_values import faces_of_row, measured_value, nominal_value
from dqreg.inspection.regions import Outcome
from dqreg.inspection.scanned_part import ScannedPart
from dqreg.inspection.sections import Section, section_on
from dqreg.inspection.tolerances import REQUIRED_SHARE, Tolerance, limits_at


@dataclasses.dataclass(frozen=True)
class Characteristic:
    """One measured line of the drawing.

    Attributes
    ----------
    name, kind : str
        As in the plan.
    faces : tuple of int
        Numbers of its faces.
    nominal : float
        From the plan or the part; 0 for zones.
    low, high : float
        Limits of the value.
    value, uncertainty : float
        Measured, and expanded (k = 2): a length, or degrees for angles; NaN where it could not be measured.
    outcome : {"pass", "fail", "undecided"}
        By ISO 14253-1; undecided where it could not be measured.
    points : int
        Scan points that it rests on.
    coverage : float
        Share of its faces' area that was scanned, in the least of them; NaN where it is not of this part.
    position : tuple of three float
        Where it is on the part, in the caller's target frame: for a label.
    remark : str
        Why it could not be measured; empty where it was.
    fit : {"gauss", "minimum-zone", "inscribed", "circumscribed"}
        How its features were fitted.
    """

    name: str
    kind: str
    faces: tuple[int, ...]
    nominal: float
    low: float
    high: float
    value: float
    uncertainty: float
    outcome: Outcome
    points: int
    coverage: float
    position: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    remark: str = ""
    fit: str = "gauss"

    @property
    def measured(self) -> bool:
        """Whether there is a value."""
        return not self.remark


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
        this part, is undecided and says why.

    Raises
    ------
    InputError
        If the target is no mesh, an entry beside the characteristics names a face that the part has not, or nothing
        that the plan asks for is of this part.
    DegenerateGeometryError
        If a datum has too few scan points, or the datums leave a degree of freedom unconstrained.

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
    part = aligned.part
    laid, decision = _judged(deviations, plan, aligned)
    rows = _characteristics(part, plan, aligned.frame, alone=decision is None)
    return Inspection(
        outcome=worst_of([*(row.outcome for row in rows), *([decision.outcome] if decision else [])]),
        characteristics=rows,
        alignment=aligned.final,
        plan=plan,
        faces=_faces(part, plan, rows),
        steps=aligned.steps,
        sections=tuple((cut.name, _section(part, cut)) for cut in plan.sections),
        decision=decision,
        deviations=laid,
    )


def _characteristics(part: ScannedPart, plan: Plan, frame: KnownFrame, *, alone: bool) -> tuple[Characteristic, ...]:
    """All that a plan asks for; where nothing else is, one of them must be of this part."""
    rows: list[Characteristic] = []
    refused: list[InputError] = []
    for row in plan.characteristics:
        try:
            rows.append(_measured(part, plan, row, frame))
        except InputError as error:
            refused.append(error)
            rows.append(_refused(row, error))
    if alone and refused and len(refused) == len(rows):
        raise refused[0]
    return tuple(rows)


def _refused(row: PlannedCharacteristic, error: InputError) -> Characteristic:
    """A characteristic that is not of this part, which costs no other line of the sheet."""
    nominal = math.nan if row.nominal is None else row.nominal
    low, high = _limits(row, nominal)
    return Characteristic(
        name=row.name,
        kind=row.kind,
        faces=(),
        nominal=nominal,
        low=low,
        high=high,
        value=math.nan,
        uncertainty=math.nan,
        outcome="undecided",
        points=0,
        coverage=math.nan,
        remark=str(error.__cause__ or error),
        fit=row.fit,
    )


def _limits(row: PlannedCharacteristic, nominal: float) -> tuple[float, float]:
    return (0.0, row.plus) if row.kind in ZONES else (nominal - row.minus, nominal + row.plus)


def _judged(deviations: Deviations, plan: Plan, aligned: AlignedPart) -> tuple[Deviations, Decision | None]:
    """Deviations under the alignment of the plan, and the decision on them where they have a tolerance."""
    part, final = aligned.part, aligned.final
    if final is not None:
        deviations = deviations_under(deviations, final.T_target_source, final.covariance, final.centre)
    own: dict[int, Tolerance] = {}
    for row in plan.face_tolerances:
        with entry(row.where):
            own |= {face.number: row.tolerance for face in part.named(row.faces)}
    if plan.tolerance is None and not own:
        return deviations, None
    required = (plan.tolerance.required_share if plan.tolerance else None) or REQUIRED_SHARE
    decision = decide(deviations, plan.tolerance, required, own)
    limits = None
    if own or (plan.tolerance is not None and not plan.tolerance.equal):
        limits = limits_at(part.of_triangle[deviations.faces], plan.tolerance, own)
    return dataclasses.replace(deviations, tolerance=decision.tolerance, allowed=limits), decision


def _section(part: ScannedPart, cut: PlannedSection) -> Section:
    with entry(f"section {cut.name!r}"):
        return section_on(part, np.array(cut.point), np.array(cut.normal))


def _faces(part: ScannedPart, plan: Plan, rows: tuple[Characteristic, ...]) -> tuple[FaceCoverage, ...]:
    used = {number for row in rows for number in row.faces}
    used |= {part.face(datum.face).number for datum in plan.datums}
    used |= {face.number for each in plan.face_tolerances for face in part.named(each.faces)}
    counts, shares = part.counts(), part.coverage()
    return tuple(
        FaceCoverage(f.number, f.kind, f.area, int(counts[f.number]), float(shares[f.number]), f.number in used)
        for f in part.faces
    )


def _measured(part: ScannedPart, plan: Plan, row: PlannedCharacteristic, frame: KnownFrame) -> Characteristic:
    remark = ""
    with entry(f"characteristic {row.name!r}"):
        faces = faces_of_row(part, row)
        nominal = row.nominal if row.nominal is not None else nominal_value(part, row, faces)
        try:
            found = measured_value(part, plan, row, faces, frame)
        except DegenerateGeometryError as error:
            # A face that the scanner did not see costs its own lines of the sheet only.
            found, remark = Measured(math.nan, math.nan), str(error)
    low, high = _limits(row, nominal)
    # A zone's width is never below zero: its lower limit cannot be violated.
    outcome: Outcome = "undecided" if remark else found.decide(-math.inf if row.kind in ZONES else low, high)
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
        outcome=outcome,
        points=sum(len(part.on(face)) for face in faces),
        coverage=min(float(shares[face.number]) for face in faces),
        position=part.label(faces[0]) if found.place is None else part.labelled(found.place),
        remark=remark,
        fit=row.fit,
    )
