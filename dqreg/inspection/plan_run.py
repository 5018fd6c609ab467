"""A plan carried out on a registered scan: features, datum alignment, characteristics, decisions."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.alignment import Datum, DatumAlignment, align_datums
from dqreg.inspection.characteristics import Frame, Measured
from dqreg.inspection.coverage import FaceCoverage
from dqreg.inspection.decision import worst_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.measured_values import measured_value, nominal_value
from dqreg.inspection.plan import ZONES, Plan, PlannedCharacteristic, PlannedDatum
from dqreg.inspection.regions import Outcome
from dqreg.inspection.scanned_part import ScannedPart
from dqreg.rigid import pose

# Times that the scan is laid on the datums: the first pose decides which points are on which face.
ROUNDS = 3


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
        Share of its faces' area that was scanned, in the least of them.
    position : tuple of three float
        Where it is on the part, in the caller's target frame: for a label.
    remark : str
        Why it could not be measured; empty where it was.
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
        The worst of the characteristics.
    characteristics : tuple of Characteristic
        In the order of the plan.
    alignment : DatumAlignment or None
        In the caller's target frame, from the registered scan onto the datums; None for the best fit.
    plan : Plan
        What was asked.
    faces : tuple of FaceCoverage
        How much of every face of the part was scanned.
    """

    outcome: Outcome
    characteristics: tuple[Characteristic, ...]
    alignment: DatumAlignment | None
    plan: Plan
    faces: tuple[FaceCoverage, ...] = ()


def inspect(deviations: Deviations, plan: Plan) -> Inspection:
    """Carry out a plan on a registered scan.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh.
    plan : Plan
        From `read_plan`.

    Returns
    -------
    Inspection
        A value, an uncertainty and a decision for every characteristic; one whose faces were not scanned says so.

    Raises
    ------
    InputError
        If the target is no mesh, or an entry names a face that the part has not or that has no such characteristic.
    DegenerateGeometryError
        If a datum has too few scan points, or the datums leave a degree of freedom unconstrained.
    """
    part, T, aligned = ScannedPart.of(deviations), np.eye(4), None
    frame = Frame(np.nan_to_num(deviations.covariance, nan=0.0), deviations.centre - deviations.origin)
    for _ in range(ROUNDS if plan.alignment == "datums" else 0):
        # Which face a point near an edge belongs to is asked again under the new pose.
        aligned = align_datums([_datum(part, datum) for datum in plan.datums])
        T = aligned.T_target_source @ T
        part = part.moved(aligned.T_target_source)
        frame = Frame(aligned.covariance, aligned.centre)
    rows = tuple(_measured(part, plan, row, frame) for row in plan.characteristics)
    if aligned is not None:
        # Features were fitted about the part's middle, where coordinates keep their digits.
        shift = pose.from_parts(np.eye(3), deviations.origin)
        moved = shift @ T @ pose.inverse(shift)
        aligned = dataclasses.replace(aligned, T_target_source=moved, centre=aligned.centre + deviations.origin)
    return Inspection(worst_of([row.outcome for row in rows]), rows, aligned, plan, _faces(part, plan, rows))


def _datum(part: ScannedPart, datum: PlannedDatum) -> Datum:
    with _entry(f"datum {datum.name}"):
        face = part.face(datum.face)
        return Datum(datum.name, part.measured(face), part.ideal(face))


def _faces(part: ScannedPart, plan: Plan, rows: tuple[Characteristic, ...]) -> tuple[FaceCoverage, ...]:
    used = {number for row in rows for number in row.faces}
    used |= {part.face(datum.face).number for datum in plan.datums}
    counts, shares = part.counts(), part.coverage()
    return tuple(
        FaceCoverage(f.number, f.kind, f.area, int(counts[f.number]), float(shares[f.number]), f.number in used)
        for f in part.faces
    )


@contextlib.contextmanager
def _entry(where: str) -> Iterator[None]:
    """Errors inside name an entry of the plan."""
    try:
        yield
    except (InputError, DegenerateGeometryError) as error:
        raise type(error)(f"{where}: {error}") from error


def _measured(part: ScannedPart, plan: Plan, row: PlannedCharacteristic, frame: Frame) -> Characteristic:
    remark = ""
    with _entry(f"characteristic {row.name!r}"):
        faces = [part.face(name) for name in row.faces]
        nominal = row.nominal if row.nominal is not None else nominal_value(part, row, faces)
        try:
            found = measured_value(part, plan, row, faces, frame)
        except DegenerateGeometryError as error:
            # A face that the scanner did not see costs its own lines of the sheet only.
            found, remark = Measured(math.nan, math.nan), str(error)
    low, high = (0.0, row.plus) if row.kind in ZONES else (nominal - row.minus, nominal + row.plus)
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
        position=part.label(faces[0]),
        remark=remark,
    )
