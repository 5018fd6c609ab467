"""A scanned part under the alignment of a plan: datums, or steps that follow each other."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.alignment import (
    Datum,
    DatumAlignment,
    FaceTerms,
    PointAlignment,
    SurfaceAlignment,
    align_datums,
    align_points,
    align_surface,
)
from dqreg.inspection.alignment.earlier_steps import covariance_after, kept_by, with_kept
from dqreg.inspection.decision.places import MEDIAN_SIGMA, PLACE_POINTS
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.facing_sides import closest_as_before
from dqreg.inspection.drawing.characteristics import KnownFrame
from dqreg.inspection.plan.alignment import PlannedStep
from dqreg.inspection.plan.file import Plan, PlannedDatum
from dqreg.inspection.scanned_part.scanned_part import ScannedPart
from dqreg.rigid import pose

Alignment = DatumAlignment | PointAlignment | SurfaceAlignment

# Times that the scan is laid on the datums: the first pose decides which points are on which face.
DATUM_ROUNDS = 3
# A reference point is measured where scan points lie within so many usual spacings.
POINT_REACH_SPACINGS = 4.0
# And stands on the part to that share of its size.
MAX_OFF_PART_DIAGONALS = 0.05


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedStep:
    """A step of the alignment that was carried out.

    Attributes
    ----------
    name, kind : str
        As in the plan.
    T_target_source : ndarray, (4, 4)
        From the registered scan to the scan after this step, in the caller's target frame.
    alignment : DatumAlignment, PointAlignment or SurfaceAlignment
        What was found, from the step before; about the part's middle.
    """

    name: str
    kind: str
    T_target_source: FloatArray
    alignment: Alignment


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedPart:
    """The part with the scan under its alignment."""

    part: ScannedPart
    frame: KnownFrame
    steps: tuple[AlignedStep, ...]  # None for the best fit
    missing: str = ""  # Why this scan does not hold the alignment; it is as it was registered then

    def require(self) -> None:
        """Raise where the scan does not hold the alignment that is asked for."""
        if self.missing:
            raise DegenerateGeometryError("it is under the alignment of the plan, which was not measured")

    @property
    def final(self) -> Alignment | None:
        """The last alignment with the pose of all steps and its covariance, in the caller's target frame."""
        if not self.steps:
            return None
        last = self.steps[-1]
        centre = last.alignment.centre + self.part.origin
        return dataclasses.replace(
            last.alignment, T_target_source=last.T_target_source, covariance=self.frame.covariance, centre=centre
        )


def aligned_part(deviations: Deviations, plan: Plan) -> AlignedPart:
    """Carry out the alignment of a plan, or say why this scan does not hold it."""
    part = ScannedPart.of(deviations)
    frame = KnownFrame(np.nan_to_num(deviations.covariance, nan=0.0), deviations.centre - deviations.origin)
    try:
        return _aligned(part, frame, deviations, plan)
    except DegenerateGeometryError as error:
        return AlignedPart(part, frame, (), str(error))


def _aligned(part: ScannedPart, frame: KnownFrame, deviations: Deviations, plan: Plan) -> AlignedPart:
    planned = plan.steps
    if plan.alignment == "datums":
        planned = (PlannedStep("datums", "datums"),)
    T, steps = np.eye(4), []
    shift = pose.from_parts(np.eye(3), part.origin)
    for step in planned:
        with entry(f"alignment {step.name!r}") if plan.steps else contextlib.nullcontext():
            start = T
            for _ in range(DATUM_ROUNDS if step.kind == "datums" else 1):
                # Which face a point near an edge belongs to is asked again under the new pose.
                found = _found(part, deviations, plan, step, T, start)
                T = found.T_target_source @ T
                part = part.moved(found.T_target_source)
        frame = KnownFrame(covariance_after(found, frame.covariance, frame.centre), found.centre)
        steps.append(AlignedStep(step.name, step.kind, shift @ T @ pose.inverse(shift), found))
    return AlignedPart(part, frame, tuple(steps))


@contextlib.contextmanager
def entry(where: str) -> Iterator[None]:
    """Errors inside name an entry of the plan."""
    try:
        yield
    except (InputError, DegenerateGeometryError) as error:
        raise type(error)(f"{where}: {error}") from error


def _found(
    part: ScannedPart, deviations: Deviations, plan: Plan, step: PlannedStep, T: FloatArray, start: FloatArray
) -> Alignment:
    """The alignment of one step, from the pose T, about the part's middle; a prior is of the pose where it starts."""
    if step.kind == "datums":
        _require_different(part, plan.datums)
        datums = [_datum(part, datum) for datum in plan.datums]
        begin = start @ pose.inverse(T)
        return align_datums(
            datums, begin, dof=step.dof, prior=_prior(step, begin, datums[0].nominal.point - part.mesh.centre)
        )
    if step.kind == "points":
        return _points(part, step)
    names = step.faces or tuple(range(len(part.faces)))
    low, high = step.band or (-np.inf, np.inf)
    terms = {
        face.number: FaceTerms(weight, low, high)
        for name, weight in zip(names, step.weights or (1.0,) * len(names), strict=True)
        for face in part.named([name])
    }
    shift = pose.from_parts(np.eye(3), part.origin)
    moved = pose.apply(shift @ T @ pose.inverse(shift), deviations.points)
    before = part.mesh.face_normals[deviations.faces]
    faces = closest_as_before(moved - part.origin, part.surface, before).elements
    scan = dataclasses.replace(deviations, points=moved, faces=faces)
    found = align_surface(scan, step.kind, faces=terms, dof=step.dof, prior=_prior(step, np.eye(4), np.zeros(3)))
    inner = pose.inverse(shift) @ found.T_target_source @ shift
    about_middle = dataclasses.replace(found, T_target_source=inner, centre=found.centre - part.origin)
    return with_kept(about_middle, kept_by(found))


def _prior(step: PlannedStep, T: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    return None if step.prior is None else (T, step.prior.covariance(by))


def _require_different(part: ScannedPart, datums: tuple[PlannedDatum, ...]) -> None:
    seen: dict[int, str] = {}
    for datum in datums:
        with entry(f"datum {datum.name}"):
            number = part.face(datum.face).number
            if number in seen:
                raise InputError(f"it is face {number}, as datum {seen[number]} is: a datum is of a face of its own")
        seen[number] = datum.name


def _datum(part: ScannedPart, datum: PlannedDatum) -> Datum:
    with entry(f"datum {datum.name}"):
        face = part.face(datum.face)
        return Datum(datum.name, part.measured(face, datum.fit), part.ideal(face))


def _points(part: ScannedPart, step: PlannedStep) -> PointAlignment:
    """Reference points, each measured by the median deviation of the scan points that are nearest to it."""
    from scipy.spatial import cKDTree

    given = np.array([each[:3] for each in step.points]) - part.origin
    nominal = part.surface.closest(given)
    beside = np.linalg.norm(given - nominal.points, axis=1)
    if (beside > MAX_OFF_PART_DIAGONALS * part.mesh.diagonal).any():
        k = int(np.argmax(beside))
        raise InputError(
            f"reference point {list(step.points[k][:3])} lies {beside[k]:.4g} beside the part: give a place on it, in "
            "the part's frame and the plan's unit"
        )
    normals = part.mesh.face_normals[nominal.elements]
    feet, own, values = part.deviations()
    away, rows = cKDTree(feet).query(nominal.points, k=min(PLACE_POINTS, len(feet)))
    rows = np.asarray(rows, dtype=np.int64).reshape(len(given), -1)
    # Of a neighbouring face the deviations are along another normal.
    alike = np.einsum("ijk,ik->ij", own[rows], normals) > 0.9
    near = (np.asarray(away).reshape(rows.shape) <= POINT_REACH_SPACINGS * part.spacing * np.sqrt(PLACE_POINTS)) & alike
    for k, each in enumerate(step.points):
        if not near[k].any():
            raise DegenerateGeometryError(
                f"reference point {list(each[:3])} was not scanned: no scan point lies near it"
            )
    medians = np.array([np.median(values[row[kept]]) for row, kept in zip(rows, near, strict=True)])
    counts = near.sum(axis=1)
    directions = [each[3:] if len(each) == 6 else normal for each, normal in zip(step.points, normals, strict=True)]
    sigma = MEDIAN_SIGMA * max(part.noise, 1e-12 * part.mesh.diagonal) / np.sqrt(counts)
    measured = nominal.points + medians[:, None] * normals
    known = _prior(step, np.eye(4), nominal.points.mean(axis=0) - part.mesh.centre)
    return align_points(measured, nominal.points, directions, sigma=sigma, dof=step.dof, prior=known)
