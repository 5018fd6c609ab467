"""A part with the scan's points on each of its faces: features measured there, and how much of a face was scanned."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection.decision.coverage import covered, usual_density
from dqreg.inspection.decision.medians import smoothed
from dqreg.inspection.decision.places import MEDIAN_SIGMA, PLACE_POINTS
from dqreg.inspection.decision.regions import MIN_DENSITY_RATIO, edge_places
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.facing_sides import closest_as_before
from dqreg.inspection.deviations.wall_doubts import WallDoubt
from dqreg.inspection.drawing.zone_features import PlannedFit, zone_feature
from dqreg.inspection.features import Feature, fit_feature
from dqreg.inspection.features.spread import covariance_on, hidden_form
from dqreg.inspection.membership.membership import EXCLUDED
from dqreg.inspection.part_faces import Face, faces_at, faces_in_box, nearest_face, part_faces
from dqreg.inspection.plan.keys import FaceName
from dqreg.inspection.statistics import MIN_SCANNED_POINTS
from dqreg.rigid import pose

# Points farther from a feature than that many robust standard deviations are cut.
CUT_SIGMAS = 3.5
# Points nearer to an edge than so many times what 95 % of the deviations do not exceed may be of the face beyond it.
MIXED_QUANTILES = 2.0
# At most that share of a face's extent is left out so, and never half of its points.
MAX_EDGE_EXTENTS, MIN_INNER_SHARE = 0.05, 0.5
# Places along edges are that part of the usual spacing apart.
EDGE_STEP_SPACINGS = 0.1
# Faces are the wall of a slot where their corners lie within that share of its length of one.
MAX_SLOT_FORM_LENGTHS = 1e-3


def outlier_cut(points: FloatArray | IntArray) -> float | None:
    """Beyond which outliers of a face are cut, in sigmas; None of few points, each of which a touch probe measured."""
    return CUT_SIGMAS if len(points) > MIN_SCANNED_POINTS else None


@dataclasses.dataclass(eq=False)
class ScannedPart:
    """The part's faces and the scan's points on each, about the part's middle."""

    mesh: Mesh
    faces: tuple[Face, ...]
    of_triangle: IntArray  # Number of the face of each triangle
    origin: FloatArray  # Of the caller's frame
    points: FloatArray  # (n, 3): Scan points on the part
    triangles: IntArray  # (n,): Triangle that is closest to each
    surface: MeshSurface

    def __post_init__(self) -> None:
        self._features: dict[tuple[int, str], Feature] = {}
        self._covered: FloatArray | None = None
        self._noise: float | None = None
        self._found: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._from_edges: FloatArray | None = None
        self._mixed = 0.0
        self._doubts: tuple[WallDoubt, ...] = ()
        self._beside = np.zeros((0, 3))  # Points of the scan that are not counted, of an open part
        self._on = self.of_triangle[self.triangles]
        self._density = usual_density(self._on, np.array([face.area for face in self.faces]))

    @classmethod
    def of(cls, deviations: Deviations) -> ScannedPart:
        """The part as the registration laid the scan on it."""
        mesh = deviations.target
        if not isinstance(mesh, Mesh):
            raise InputError("an inspection needs a mesh as its target: a cloud has no faces")
        on = deviations.counted
        points = deviations.points[on] - deviations.origin
        labels, origin, faces = faces_of(mesh)[1], deviations.origin, deviations.faces[on]
        part = cls(mesh, part_faces(mesh), labels, origin, points, faces, MeshSurface(mesh))
        part._keep(deviations.closest[on] - origin, mesh.face_normals[faces])
        part._doubts = tuple(each.moved(pose.from_parts(np.eye(3), -origin)) for each in deviations.wall_doubts)
        if not mesh.is_closed:
            part._beside = deviations.points[~on & (deviations.flags != EXCLUDED)] - origin
        return part

    def moved(self, T: FloatArray) -> ScannedPart:
        """The same with the scan under another pose."""
        points = pose.apply(T, self.points)
        found = closest_as_before(points, self.surface, self.mesh.face_normals[self.triangles])
        of_part = self.mesh, self.faces, self.of_triangle, self.origin
        part = ScannedPart(*of_part, points, found.elements, self.surface)
        part._keep(found.points, found.normals)
        part._doubts = tuple(each.moved(T) for each in self._doubts)
        part._beside = pose.apply(T, self._beside)
        return part

    def wall_doubt(self, faces: Collection[int]) -> WallDoubt | None:
        """A patch on one of some faces that may be of the other side of their wall; None where there is none."""
        at = np.reshape([each.position for each in self._doubts], (-1, 3))
        numbers = self.of_triangle[self.surface.closest(at).elements] if len(at) else ()
        found = (each for each, number in zip(self._doubts, numbers, strict=True) if number in faces)
        return next(found, None)

    def _keep(self, feet: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        self._found = feet, normals, np.asarray(np.einsum("ij,ij->i", self.points - feet, normals))
        return self._found

    def face(self, name: FaceName) -> Face:
        """The one face that a plan names."""
        found = self.named([name])
        if len(found) > 1:
            numbers = ", ".join(str(face.number) for face in found)
            raise InputError(f"the box {_words(name)} holds faces {numbers}: make it smaller, or give face = NUMBER")
        return found[0]

    def named(self, names: Sequence[FaceName]) -> list[Face]:
        """The faces that a plan names, each once; a box stands for all that lie in it."""
        found: dict[int, Face] = {}
        for name in names:
            found |= {face.number: face for face in self._named(name)}
        return list(found.values())

    def _named(self, name: FaceName) -> tuple[Face, ...]:
        if not isinstance(name, tuple):
            if name >= len(self.faces):
                raise InputError(f"the part has no face {name}; its faces are 0 to {len(self.faces) - 1}")
            return (self.faces[name],)
        if len(name) == 3:
            place = np.array(name) - self.origin
            if len(met := faces_at(self.mesh, place)) > 1:
                # From beside the part an edge is nearest, and a face of it would be a matter of rounding.
                numbers = " and ".join(map(str, met))
                raise InputError(
                    f"{_words(name)} is nearest to the edge of faces {numbers}: give a place on one of them"
                )
            return (nearest_face(self.mesh, self.faces, place),)
        within = faces_in_box(self.mesh, self.faces, np.array(name) - np.tile(self.origin, 2))
        if not within:
            raise InputError(f"no face of the part lies as a whole in the box {_words(name)}; see dqreg faces --box")
        return within

    def on(self, face: Face) -> FloatArray:
        """Scan points on a face, away from its edges, (n, 3)."""
        return self.points[self.rows_on(face)]

    def rows_on(self, face: Face) -> IntArray:
        """Rows of the scan points on a face, away from its edges: nearer to them, the points of two faces mix."""
        rows = np.flatnonzero(self._on == face.number)
        if self._from_edges is None:
            self._from_edges, self._mixed = self._edges()
        inner = rows[self._from_edges[rows] > min(self._mixed, MAX_EDGE_EXTENTS * face.extent)]
        return inner if len(inner) > MIN_INNER_SHARE * len(rows) else rows

    def _edges(self) -> tuple[FloatArray, float]:
        """Distance of each point's foot from the nearest edge, and how far from one the points of two faces mix."""
        from scipy.spatial import cKDTree

        feet, _, values = self.deviations()
        mixed = MIXED_QUANTILES * float(np.quantile(np.abs(values), 0.95)) if len(values) else 0.0
        places, step = edge_places(self.mesh, self.of_triangle, max(0.5 * mixed, EDGE_STEP_SPACINGS * self.spacing))
        if not len(places) or not len(feet):
            return np.full(len(feet), np.inf), 0.0
        width = math.hypot(mixed, 0.5 * step)
        # Farther ones need no distance: they are infinitely far.
        away = cKDTree(places).query(feet, distance_upper_bound=1.01 * width)[0]
        return np.asarray(away, dtype=np.float64), width

    @property
    def face_of_points(self) -> IntArray:
        """Number of the face of each scan point."""
        return self._on

    @property
    def spacing(self) -> float:
        """Usual distance of neighbouring scan points on the part."""
        return float(1.0 / np.sqrt(self._density))

    @property
    def noise(self) -> float:
        """Standard deviation of a scan point, from how neighbours on one face differ."""
        if self._noise is None:
            sigma = smoothed(self.deviations()[2], self.points, self._on)[1]
            self._noise = sigma * math.sqrt(PLACE_POINTS) / MEDIAN_SIGMA
        return self._noise

    def deviations(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Closest places of the part to the scan points, outward normals there, signed distances."""
        if self._found is not None:
            return self._found
        found = self.surface.closest(self.points)
        return self._keep(found.points, self.mesh.face_normals[found.elements])

    def ideal(self, face: Face) -> Feature:
        """What a face is on the part itself."""
        if face.feature is None:
            raise InputError(f"face {face.number}, {face.kind}, is neither plane, cylinder, cone nor sphere")
        return face.feature

    def measured(self, face: Face, fit: PlannedFit = "gauss") -> Feature:
        """The feature that is fitted to the scan's points on a face."""
        if (key := (face.number, fit)) not in self._features:
            found = self._least_squares(face) if fit == "gauss" else self._by_zone(face, fit)
            nominal = self.ideal(face)
            alike = found.kind == "sphere" or found.axis @ nominal.axis > 0.0
            self._features[key] = found if alike else found.reversed()
        return self._features[key]

    def _by_zone(self, face: Face, fit: PlannedFit) -> Feature:
        rows = self.rows_on(face)
        normals = self.mesh.face_normals[self.triangles[rows]]
        return zone_feature(self.measured(face), fit, self.points[rows], normals, self.noise)

    def _least_squares(self, face: Face) -> Feature:
        self.require_scanned(face)
        nominal, rows = self.ideal(face), self.rows_on(face)
        points, normals = self.points[rows], self.mesh.face_normals[self.triangles[rows]]
        try:
            found = fit_feature(points, nominal.kind, normals=normals, cut=outlier_cut(points))
        except DegenerateGeometryError as error:
            words = f"face {face.number} was not scanned well enough: {error}"
            raise DegenerateGeometryError(words) from error
        inner = len(rows) / max(int(np.count_nonzero(self._on == face.number)), 1)
        scanned = min(float(self.coverage()[face.number]) * inner, 1.0)
        covariance = covariance_on(
            found.kind, found.shape, points, covariance=found.covariance, rms=found.rms, scanned=scanned
        )
        return dataclasses.replace(found, covariance=covariance + hidden_form(found.kind, found.shape, points))

    def corners(self, faces: Sequence[Face]) -> FloatArray:
        """Corners of some faces of the part itself: how far they reach, (k, 3)."""
        return self.mesh.vertices[np.unique(self.mesh.faces[self._triangles(faces)])]

    def _triangles(self, faces: Sequence[Face]) -> IntArray:
        return np.flatnonzero(np.isin(self.of_triangle, [face.number for face in faces]))

    def ideal_slot(self, faces: Sequence[Face]) -> Feature:
        """The slot whose wall some faces are, on the part itself."""
        triangles = self._triangles(faces)
        corners = self.mesh.corners[triangles].reshape(-1, 3)
        numbers = ", ".join(str(face.number) for face in faces)
        refusal = f"faces {numbers} are not the wall of a slot: name its two flat sides and both round ends"
        try:
            found = fit_feature(corners, "slot", normals=np.repeat(self.mesh.face_normals[triangles], 3, axis=0))
        except DegenerateGeometryError as error:
            raise InputError(refusal) from error
        if found.form > MAX_SLOT_FORM_LENGTHS * found.length:
            raise InputError(refusal)
        return found

    def measured_slot(self, faces: Sequence[Face]) -> Feature:
        """The slot that is fitted to the scan's points on some faces."""
        for face in faces:
            self.require_scanned(face)
        rows = np.concatenate([self.rows_on(face) for face in faces])
        normals = self.mesh.face_normals[self.triangles[rows]]
        found = fit_feature(self.points[rows], "slot", normals=normals, cut=outlier_cut(rows))
        return found if found.axis @ self.ideal_slot(faces).axis > 0.0 else found.reversed()

    def require_scanned(self, face: Face) -> None:
        """`DegenerateGeometryError` where a face has too few points for a face that was scanned."""
        count, usual = int(np.count_nonzero(self._on == face.number)), self._density * face.area
        if count < MIN_DENSITY_RATIO * usual:
            raise DegenerateGeometryError(
                f"face {face.number} was not scanned: {count} points lie on it where {usual:.0f} are expected; "
                "dqreg inspect SCAN --suggest PART names faces that were"
            )

    def scanned(self) -> BoolArray:
        """Which faces have enough points for faces that were scanned, (faces,)."""
        usual = self._density * np.array([face.area for face in self.faces])
        return np.asarray(self.counts() >= MIN_DENSITY_RATIO * usual)

    def counts(self) -> IntArray:
        """Scan points on each face, (faces,)."""
        return np.bincount(self._on, minlength=len(self.faces)).astype(np.int64)

    def coverage(self) -> FloatArray:
        """Share of each face's area that was scanned, (faces,)."""
        if self._covered is None:
            self._covered = covered(self.mesh, self.of_triangle, self.points, self._on, self._density)
        return self._covered

    def label(self, face: Face) -> tuple[float, float, float]:
        """Where a label of a face stands, in the caller's target frame: on it, or in the middle of a round one."""
        at, points = face.centre, self.on(face)
        if face.kind in ("plane", "torus", "free") and len(points):
            at = points[np.argmin(np.linalg.norm(points - at, axis=1))]
        return self.labelled(at)

    def labelled(self, place: FloatArray) -> tuple[float, float, float]:
        """A place, (3,), in the caller's target frame."""
        x, y, z = (place + self.origin).tolist()
        return x, y, z


def _words(name: FaceName) -> str:
    return "[" + ", ".join(f"{x:g}" for x in name) + "]" if isinstance(name, tuple) else str(name)
