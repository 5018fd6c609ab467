"""Points of a scan on chosen faces of a part, as rows of a cost: distances from the faces and their derivatives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.mesh_faces import areas_of, faces_of
from dqreg.geometry.morton import morton_order
from dqreg.inspection.alignment.earlier_steps import left_of
from dqreg.inspection.decision.coverage import covered_places, usual_density
from dqreg.inspection.decision.medians import smoothed
from dqreg.inspection.decision.places import PLACE_POINTS
from dqreg.inspection.decision.regions import MIN_DENSITY_RATIO
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.outward_side import require_sides
from dqreg.rigid import pose, twist
from dqreg.solvers import Freedom, PoseCost
from dqreg.solvers.robust import scatter_of

# Points that an alignment takes at most, evenly over the scan; more say the same.
MAX_POINTS = 100_000
MIN_POINTS = 6


@dataclasses.dataclass(frozen=True)
class FaceTerms:
    """How a face of the part takes part in an alignment.

    Attributes
    ----------
    weight : float
        Of each of its points, above 0.
    low, high : float
        Its tolerance band: signed deviations allowed, positive outside the part, target units.

    Raises
    ------
    InputError
        If the weight is not above 0, or low not below high.

    Examples
    --------
    >>> FaceTerms(weight=2.0, low=0.0).high
    inf
    """

    weight: float = 1.0
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not 0.0 < self.weight < math.inf:
            raise InputError(f"the weight of a face must be above 0; got {self.weight!r}")
        if not self.low < self.high:
            raise InputError(f"the band of a face needs low below high; got {self.low!r} and {self.high!r}")


@dataclasses.dataclass(frozen=True, eq=False)
class SurfaceRows:
    """Scan points on chosen faces, in Morton order, about the origin of the deviations."""

    points: FloatArray  # (n, 3)
    labels: IntArray  # (n,): Number of the face of each
    offsets: FloatArray  # (n,): Median of the neighbourhood less the point's own deviation; 0 without medians
    sigma: float  # Standard deviation of such a median; NaN without
    weights: FloatArray  # (n,)
    low: FloatArray  # (n,)
    high: FloatArray  # (n,)
    surface: MeshSurface  # The chosen faces alone
    origin: FloatArray  # (3,): Of the caller's frame
    centre: FloatArray  # (3,): Middle of the part, about the origin
    size: float  # Diagonal of the part
    whole: FloatArray  # (6, 6): Information of the area of those that were scanned
    seen: FloatArray  # (6, 6): And of what of it was scanned

    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Points under a pose, signed distances, derivatives by a twist about the centre, normals of the faces."""
        moved, feet, normals = self._feet(T)
        slopes = np.hstack([np.cross(moved - self.centre, normals), normals])
        return moved, self._values(moved, feet, normals), slopes, normals

    def deviations(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances under a pose, and their derivatives by a twist about the centre. Shapes: (n,), (n, 6)."""
        _, values, slopes, _ = self.at(T)
        return values, slopes

    def place_sigma(self, T: FloatArray) -> float:
        """Standard deviation of a median of the neighbourhood, or of a point where there are no medians."""
        if not math.isnan(self.sigma):
            return self.sigma
        values = self.deviations(T)[0]
        return float(np.sqrt(np.sum(values**2) / max(len(values) - 6, 1)))

    def with_medians(self, T: FloatArray) -> SurfaceRows:
        """The same with each point's deviation replaced by the median of its neighbours' on its face, as a pose has it.

        The pose must be near: where it is off, neighbours on a curved face deviate differently.
        """
        values, _ = self.deviations(T)
        medians, sigma = smoothed(values, pose.apply(T, self.points), self.labels)
        # Fewer points are probed by hand, and are their own medians.
        known = sigma if len(values) >= 2 * PLACE_POINTS else math.nan
        return dataclasses.replace(self, offsets=medians - values, sigma=known)

    def weighed_by_noise(self, T: FloatArray) -> SurfaceRows:
        """The same with weights of maximum likelihood, as they must be beside a prior."""
        values = self.deviations(T)[0]
        spread = scatter_of(values)
        smallest = np.finfo(float).eps * self.size
        return dataclasses.replace(self, weights=self.weights / max(spread, smallest) ** 2)

    def _feet(self, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        moved = pose.apply(T, self.points)
        found = self.surface.closest(moved)
        return moved, found.points, self.surface.mesh.face_normals[found.elements]

    def _values(self, moved: FloatArray, feet: FloatArray, normals: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ij,ij->i", moved - feet, normals) + self.offsets)

    def cost(self, T: FloatArray) -> PoseCost:
        """Weighted squares of the distances from the planes of the faces at a pose."""
        _, feet, normals = self._feet(T)
        return PoseCost.planes(self.points, feet - self.offsets[:, None] * normals, normals, self.weights)

    def band_cost(self, T: FloatArray, width: float) -> PoseCost:
        """Squares of what exceeds the bands, less and less where it exceeds them by the width (Geman and McClure)."""
        moved, feet, normals = self._feet(T)
        values = self._values(moved, feet, normals)
        allowed = np.clip(values, self.low, self.high)
        weights = self.weights / (1.0 + ((values - allowed) / width) ** 2) ** 2
        return PoseCost.planes(self.points, feet + allowed[:, None] * normals, normals, weights)

    def middle_cost(self, T: FloatArray) -> PoseCost:
        """Squares of the distances from the middle of their bands, in half-widths, of the points within them alone."""
        moved, feet, normals = self._feet(T)
        values = self._values(moved, feet, normals)
        inside = (values >= self.low) & (values <= self.high)
        weights = self.weights * inside * (2.0 / (self.high - self.low)) ** 2
        return PoseCost.planes(self.points, feet + (0.5 * (self.low + self.high))[:, None] * normals, normals, weights)

    def within(self, T: FloatArray) -> float:
        """Weight of the points within their bands."""
        values, _ = self.deviations(T)
        return float(self.weights[(values >= self.low) & (values <= self.high)].sum())

    def scaled(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Deviations in half-widths of bands where all have one, times the weights, and their derivatives."""
        values, slopes = self.deviations(T)
        unit = self.weights
        if np.isfinite(self.high - self.low).all():
            values, unit = values - 0.5 * (self.low + self.high), 2.0 * self.weights / (self.high - self.low)
        return values * unit, slopes * unit[:, None]

    def height(self, T: FloatArray) -> float:
        """The largest of them."""
        return float(np.abs(self.scaled(T)[0]).max())

    def basis(self, T: FloatArray, free: Freedom) -> FloatArray:
        """Free twists about the centre, with rotations in sizes of the part: (6, k)."""
        twists = free.twists(T, np.eye(4), self.centre)
        lengths = np.linalg.norm(twists[:3], axis=0) * self.size
        return twists / np.where(lengths > 0.0, lengths, 1.0)

    def kept(self, T: FloatArray, free: Freedom, prior: FloatArray | None) -> FloatArray:
        """What is left of a twist about the centre, (6, 6), by the rows and the information of a prior."""
        information = self.cost(T).information(T, self.centre)
        return left_of(information if prior is None else information + prior, self.basis(T, free))

    def scanned(self, basis: FloatArray) -> float:
        """Share of the faces' information that lies where they were scanned, along the least of some twists, (6, k).

        Of half a face much less than half is left of the information on its tilt.
        """
        values, axes = np.linalg.eigh(basis.T @ self.whole @ basis)
        held = values > 1e-9 * values[-1]
        along = basis @ axes[:, held] / np.sqrt(values[held])
        return float(np.clip(np.linalg.eigvalsh(along.T @ self.seen @ along)[0], 0.0, 1.0)) if held.any() else 0.0

    def stepped(self, T: FloatArray, step: FloatArray, free: Freedom) -> FloatArray:
        """The pose after a twist about the centre; what is locked keeps every digit."""
        moved = pose.about(twist.exp(step), self.centre) @ T
        return moved if free.count == 6 else free.project(moved, np.eye(4))

    def length_of(self, T: FloatArray, before: FloatArray) -> float:
        """Length of the step between two poses, in sizes of the part."""
        step = twist.log(pose.about(T @ pose.inverse(before), -self.centre))
        return max(float(np.abs(step[:3]).max()), float(np.abs(step[3:]).max()) / self.size)


def rows_of(deviations: Deviations, faces: Mapping[int, FaceTerms] | None) -> SurfaceRows:
    """The counted points on the chosen faces, by the face that is closest to each under the registered pose."""
    mesh = deviations.target
    if not isinstance(mesh, Mesh):
        raise InputError("an alignment to faces needs a mesh as its target: a cloud has no faces")
    count, of_triangle = faces_of(mesh)
    chosen = {number: FaceTerms() for number in range(count)} if faces is None else dict(faces)
    for number, terms in chosen.items():
        if not 0 <= number < count:
            raise InputError(f"the part has no face {number}; its faces are 0 to {count - 1}")
        if terms.low != -terms.high:
            require_sides(mesh, "unequal sides of a band")
    of_point = of_triangle[deviations.faces]
    on = np.flatnonzero(deviations.counted & np.isin(of_point, list(chosen)))
    if len(on) < MIN_POINTS:
        raise DegenerateGeometryError(f"{len(on)} points lie on the chosen faces: choose faces that were scanned")
    points = deviations.points[on] - deviations.origin
    part = mesh if faces is None else _without_others(mesh, of_triangle, chosen)
    surface = MeshSurface(part)
    kept = np.arange(len(on))[:: -(-len(on) // MAX_POINTS)]
    kept = kept[morton_order(points[kept])]
    labels = of_point[on[kept]]
    pull = np.array([chosen[k].weight if k in chosen else 0.0 for k in range(count)])
    whole, seen = _information(mesh, of_triangle, points[kept], labels, pull)
    weights, low, high = np.array([[chosen[k].weight, chosen[k].low, chosen[k].high] for k in labels.tolist()]).T
    return SurfaceRows(
        points=points[kept],
        labels=labels,
        offsets=np.zeros(len(kept)),
        sigma=math.nan,
        weights=weights,
        low=low,
        high=high,
        surface=surface,
        origin=deviations.origin,
        centre=mesh.centre,
        size=mesh.diagonal,
        whole=whole,
        seen=seen,
    )


def _information(
    mesh: Mesh, of_triangle: IntArray, points: FloatArray, labels: IntArray, pull: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Of a twist about the middle by the area of the faces that were scanned, and by what of it was. Shapes: (6, 6)."""
    areas = areas_of(mesh, of_triangle)
    density = usual_density(labels, areas)
    places, triangles, seen = covered_places(mesh, of_triangle, points, labels, density)
    scanned = np.bincount(labels, minlength=len(areas)) >= MIN_DENSITY_RATIO * density * areas
    normals, weights = mesh.face_normals[triangles], (pull * areas * scanned)[of_triangle[triangles]]
    slopes = np.hstack([np.cross(places - mesh.centre, normals), normals])
    return (slopes.T * weights) @ slopes, (slopes.T * (weights * seen)) @ slopes


def _without_others(mesh: Mesh, labels: IntArray, chosen: Mapping[int, FaceTerms]) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[np.isin(labels, list(chosen))], mesh.units)
