"""A plan carried out on a registered scan: features, datum alignment, characteristics, decisions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import characteristics as compute
from dqreg.inspection.alignment import Datum, DatumAlignment, align_datums
from dqreg.inspection.characteristics import Measured
from dqreg.inspection.decision import worst_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.features import Feature, fit_feature
from dqreg.inspection.part_faces import Face, nearest_face, part_faces
from dqreg.inspection.plan import ZONES, FaceName, Plan, PlannedCharacteristic
from dqreg.inspection.regions import SCANNED, Outcome, faces_of, weighted_median
from dqreg.inspection.statistics import PROBED
from dqreg.rigid import pose

# Points farther from a feature than that many robust standard deviations are cut.
CUT = 3.5
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
        Measured, and expanded (k = 2): a length, or degrees for angles.
    outcome : {"pass", "fail", "undecided"}
        By ISO 14253-1.
    points : int
        Scan points that it rests on.
    coverage : float
        Share of its faces' area that was scanned, in the least of them.
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
    """

    outcome: Outcome
    characteristics: tuple[Characteristic, ...]
    alignment: DatumAlignment | None
    plan: Plan


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
        A value, an uncertainty and a decision for every characteristic.

    Raises
    ------
    InputError
        If the target is no mesh, or an entry names a face that the part has not or that has no such characteristic.
    DegenerateGeometryError
        If a feature has too few scan points, or the datums leave a degree of freedom unconstrained.
    """
    part, T, aligned = _Part.of(deviations), np.eye(4), None
    for _ in range(ROUNDS if plan.alignment == "datums" else 0):
        # Which face a point near an edge belongs to is asked again under the new pose.
        aligned = align_datums([Datum(d.name, *part.pair(d.face, f"datum {d.name}")) for d in plan.datums])
        T = aligned.T_target_source @ T
        part = part.moved(aligned.T_target_source)
    rows = tuple(_measured(part, plan, row) for row in plan.characteristics)
    if aligned is not None:
        # Features were fitted about the part's middle, where coordinates keep their digits.
        shift = pose.from_parts(np.eye(3), deviations.origin)
        moved = shift @ T @ pose.inverse(shift)
        aligned = dataclasses.replace(aligned, T_target_source=moved, centre=aligned.centre + deviations.origin)
    return Inspection(worst_of([row.outcome for row in rows]), rows, aligned, plan)


@dataclasses.dataclass(eq=False)
class _Part:
    """The part's faces and the scan's points on each, about the part's middle."""

    mesh: Mesh
    faces: tuple[Face, ...]
    of_triangle: IntArray  # Number of the face of each triangle
    origin: FloatArray  # Of the caller's frame
    points: FloatArray  # (n, 3): Scan points on the part
    triangles: IntArray  # (n,): Triangle that is closest to each
    surface: MeshSurface

    def __post_init__(self) -> None:
        self._features: dict[int, Feature] = {}
        self._on = self.of_triangle[self.triangles]
        counts = np.bincount(self._on, minlength=len(self.faces))
        areas = np.array([max(face.area, 1e-300) for face in self.faces])
        # Points for an area on the faces that were scanned, by the points.
        self._density = weighted_median(counts / areas, counts) if len(self._on) else 1.0

    @classmethod
    def of(cls, deviations: Deviations) -> _Part:
        """The part as the registration laid the scan on it."""
        mesh = deviations.target
        if not isinstance(mesh, Mesh):
            raise InputError("an inspection needs a mesh as its target: a cloud has no faces")
        on = deviations.counted
        points = deviations.points[on] - deviations.origin
        labels = faces_of(mesh)[1]
        return cls(mesh, part_faces(mesh), labels, deviations.origin, points, deviations.faces[on], MeshSurface(mesh))

    def moved(self, T: FloatArray) -> _Part:
        """The same with the scan under another pose."""
        points = pose.apply(T, self.points)
        triangles = self.surface.closest(points).elements
        return _Part(self.mesh, self.faces, self.of_triangle, self.origin, points, triangles, self.surface)

    def face(self, name: FaceName, where: str) -> Face:
        """The face that a plan names."""
        if isinstance(name, tuple):
            return nearest_face(self.mesh, self.faces, np.array(name) - self.origin)
        if name >= len(self.faces):
            raise InputError(f"{where}: the part has no face {name}; its faces are 0 to {len(self.faces) - 1}")
        return self.faces[name]

    def on(self, face: Face) -> FloatArray:
        """Scan points on a face, (n, 3)."""
        found: FloatArray = self.points[self._on == face.number]
        return found

    def pair(self, name: FaceName, where: str) -> tuple[Feature, Feature]:
        """Measured and nominal feature of a face."""
        face = self.face(name, where)
        if face.feature is None:
            raise InputError(f"{where}: face {face.number} is neither plane, cylinder, cone nor sphere")
        if face.number not in self._features:
            self._features[face.number] = self._fitted(face, face.feature, where)
        return self._features[face.number], face.feature

    def _fitted(self, face: Face, nominal: Feature, where: str) -> Feature:
        self.require_scanned(face, where)
        points, normals = self.on(face), self.mesh.face_normals[self.triangles[self._on == face.number]]
        try:
            found = fit_feature(points, nominal.kind, normals=normals, cut=CUT if len(points) > PROBED else None)
        except DegenerateGeometryError as error:
            words = f"{where}: face {face.number} was not scanned well enough: {error}"
            raise DegenerateGeometryError(words) from error
        if found.kind == "sphere" or found.axis @ nominal.axis > 0.0:
            return found
        return found.reversed()

    def require_scanned(self, face: Face, where: str) -> None:
        """`DegenerateGeometryError` where a face has too few points for a face that was scanned."""
        count, usual = len(self.on(face)), self._density * face.area
        if count < SCANNED * usual:
            raise DegenerateGeometryError(
                f"{where}: face {face.number} was not scanned: {count} points lie on it where {usual:.0f} are usual"
            )

    def coverage(self, face: Face) -> float:
        """Share of a face's area that scan points cover, by cells of three spacings."""
        points, width = self.on(face), 3.0 / math.sqrt(self._density)
        cells = len(np.unique(np.floor(points / width).astype(np.int64), axis=0))
        return min(cells * width**2 / face.area, 1.0)


def _measured(part: _Part, plan: Plan, row: PlannedCharacteristic) -> Characteristic:
    where = f"characteristic {row.name!r}"
    faces = [part.face(name, where) for name in row.faces]
    found, nominal = _value(part, plan, row, faces, where)
    # A part's file holds single precision: more digits of its nominal values are noise.
    nominal = row.nominal if row.nominal is not None else float(f"{nominal:.6g}")
    low, high = (0.0, row.plus) if row.kind in ZONES else (nominal - row.minus, nominal + row.plus)
    # A zone's width is never below zero: its lower limit cannot be violated.
    outcome = found.decide(-math.inf if row.kind in ZONES else low, high)
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
        coverage=min(part.coverage(face) for face in faces),
    )


def _value(
    part: _Part, plan: Plan, row: PlannedCharacteristic, faces: list[Face], where: str
) -> tuple[Measured, float]:
    """The value of a characteristic, and what it is on the part itself."""
    points = part.on(faces[0])
    if row.kind == "profile":
        part.require_scanned(faces[0], where)
        found = part.surface.closest(points)
        signed = np.einsum("ij,ij->i", points - found.points, part.mesh.face_normals[found.elements])
        return compute.profile(signed, points), 0.0
    pairs = [part.pair(face.number, where) for face in faces]
    measured, ideal = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    if row.kind == "diameter":
        return compute.diameter(measured[0]), ideal[0].diameter
    if row.kind == "distance":
        return compute.distance(*measured), compute.distance(*ideal).value
    if row.kind == "angle":
        return compute.angle(*measured), compute.angle(*ideal).value
    if row.kind == "form":
        return compute.form(measured[0], points), 0.0
    if row.kind == "position":
        return compute.position(measured[0], ideal[0]), 0.0
    face = next(datum.face for datum in plan.datums if datum.name == row.datum)
    return compute.orientation(measured[0], part.pair(face, f"datum {row.datum}")[0], points), 0.0
