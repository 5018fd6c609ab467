"""Wall thickness: from each scanned place of a face straight through the material to the scanned far side."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import Mesh
from dqreg.geometry.raycasting import RayScene
from dqreg.inspection.decision.medians import smoothed
from dqreg.inspection.decision.surface_model import Medians
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.outward_side import why_unsigned
from dqreg.inspection.drawing.characteristics import Measured
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.scanned_part import ScannedPart

# The far side is a wall where its normal turns from the ray by at most this cosine.
OPPOSITE_COS = 0.7
# Scan points on the far side are its measurement there within so many usual spacings.
REACH_SPACINGS = 3.0
# Noise of a face's medians lies within so many of their standard deviations, from the least to the largest.
PLATEAU_SIGMAS = 5.0


@dataclasses.dataclass(frozen=True, eq=False)
class Wall:
    """Thickness of a wall, place by place, about the part's middle."""

    values: FloatArray  # (n,)
    nominals: FloatArray  # (n,): Of the part itself
    positions: FloatArray  # (n, 3): On the face, about the part's middle
    differences: Medians  # Of both sides, from the part's own thickness
    doubt: str = ""  # Why its sides cannot be told apart somewhere

    def nominal(self, middle: float = 0.0) -> float:
        """The part's own thickness where the wall lies farthest from it, or from so much above it."""
        return float(self.nominals[int(np.argmax(np.abs(self.values - self.nominals - middle)))])

    def measured(self, middle: float = 0.0, nominal: float | None = None) -> Measured:
        """The thickness that lies farthest from the middle of its limits, without what noise adds to how far.

        ``middle`` is that of the limits above the nominal thickness: of all places where it is given, else the part's
        own at each.
        """
        if self.doubt:
            raise DegenerateGeometryError(self.doubt)
        base = self.nominals if nominal is None else np.full(len(self.values), nominal)
        above = self.nominals - base - middle
        away = self.values - base - middle
        k = int(np.argmax(np.abs(away)))
        # Places that noise alone may tell from the farthest one, all as far as each other: a wall has steps.
        level = np.abs(away) >= abs(away[k]) - PLATEAU_SIGMAS * self.differences.sigma
        flat = np.where(level, np.sign(away) * np.abs(away)[level].mean() - above, self.differences.values)
        size, spread = self.differences.corrected(
            float(abs(away[k])), lambda z: np.abs(z + above).max(axis=1), flat=np.asarray(flat)
        )
        return Measured(float(base[k]) + middle + float(np.sign(away[k])) * size, spread)


@dataclasses.dataclass(frozen=True, eq=False)
class Thickness:
    """Thickness of the wall behind a face of a part, target units.

    Attributes
    ----------
    face : int
        Number of the face.
    values, nominals : ndarray, (n,)
        Measured thickness at places of the face, and that of the part itself there.
    positions : ndarray, (n, 3)
        The places, in the caller's target frame.
    sigma : float
        Standard deviation of one value, from the scan's noise.
    value, nominal, uncertainty : float
        The thickness where it differs most from the part's, without what noise adds to that difference; the part's own
        there; and the expanded uncertainty (k = 2).
    """

    face: int
    values: FloatArray
    nominals: FloatArray
    positions: FloatArray
    sigma: float
    value: float
    nominal: float
    uncertainty: float


def thickness_of(deviations: Deviations, face: int) -> Thickness:
    """Measure the wall behind a face: from each scanned place straight through the material to the scanned far side.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh; both sides of the wall must be scanned.
    face : int
        Number of the face (`part_faces`, ``dqreg faces``).

    Returns
    -------
    Thickness
        Place by place, and where it differs most from the part's.

    Raises
    ------
    InputError
        If the target is no mesh or has no such face.
    DegenerateGeometryError
        If no wall lies behind the face, one of its sides was not scanned, or its sides cannot be told apart.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, MeshSurface
    >>> from dqreg.inspection import measure_deviations, nearest_face, part_faces
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((30.0, 20.0, 2.0)))
    >>> scan = np.random.default_rng(0).uniform([-15, -10, -1], [15, 10, 1.1], (20_000, 3))
    >>> scan[:, 2] = np.where(scan[:, 2] > 0, 1.1, -1.0)
    >>> found = measure_deviations(scan, part, MeshSurface(part))
    >>> wall = thickness_of(found, nearest_face(part, part_faces(part), (0, 0, 1)).number)
    >>> round(wall.value, 6), round(wall.nominal, 6), len(wall.values) == len(wall.positions)
    (2.1, 2.0, True)
    """
    part = ScannedPart.of(deviations)
    wall = wall_thickness(part, part.face(face))
    measured = wall.measured()
    return Thickness(
        face=face,
        values=wall.values,
        nominals=wall.nominals,
        positions=wall.positions + part.origin,
        sigma=wall.differences.sigma,
        value=measured.value,
        nominal=wall.nominal(),
        uncertainty=measured.uncertainty,
    )


def wall_thickness(part: ScannedPart, face: Face) -> Wall:
    """Thickness behind a face: medians of 25 neighbouring deviations on either side, on the part's own thickness."""
    from scipy.spatial import cKDTree

    _require_material(part.mesh, face)
    own = part.rows_on(face)
    feet, normals, values = part.deviations()
    medians, _ = smoothed(values, part.points, part.face_of_points)
    near_side = Medians.of(values[own], part.points[own], part.noise)
    single = np.full(len(own), np.nan)
    own = own[near_side.rows]
    far, far_normals, lengths, beyond = _far_side(part, feet[own], normals[own])
    kept = np.isfinite(lengths) & (np.einsum("ij,ij->i", far_normals, normals[own]) < -OPPOSITE_COS)
    asked = np.flatnonzero(kept)
    own, far, far_normals, lengths, beyond = own[kept], far[kept], far_normals[kept], lengths[kept], beyond[kept]
    if not len(own):
        raise DegenerateGeometryError(
            f"no wall lies behind face {face.number}: straight through it there is no far side"
        )
    away, nearest = cKDTree(feet).query(far)
    row = np.asarray(nearest, dtype=np.int64)
    alike = np.einsum("ij,ij->i", normals[row], far_normals) > OPPOSITE_COS
    # Strays near a face that the scanner did not see are no measurement of it.
    seen = (away <= REACH_SPACINGS * part.spacing) & alike & part.scanned()[beyond]
    if not seen.any():
        raise DegenerateGeometryError(f"the far side of the wall behind face {face.number} was not scanned")
    asked, own, row, lengths = asked[seen], own[seen], row[seen], lengths[seen]
    lean = -np.einsum("ij,ij->i", far_normals[seen], normals[own])
    thick = lengths + near_side.values[asked] + medians[row] / lean
    # The thickness point by point: the surface of one side alone does not tell how many places compete.
    single[near_side.rows[asked]] = values[own] + values[row] / lean
    both = dataclasses.replace(
        near_side,
        own=single,
        noise=float(np.sqrt(2.0)) * part.noise,
        rows=near_side.rows[asked],
        values=thick - lengths,
        sigma=float(np.sqrt(2.0)) * near_side.sigma,
        around=near_side.around[asked],
    )
    return Wall(thick, lengths, feet[own], both, _doubt_of(part, face, beyond[seen]))


def _doubt_of(part: ScannedPart, face: Face, beyond: IntArray) -> str:
    doubt = part.wall_doubt({face.number, *np.unique(beyond).tolist()})
    if doubt is None:
        return ""
    at = ", ".join(f"{x:.6g}" for x in doubt.position + part.origin)
    return (
        f"the sides of the wall behind face {face.number} cannot be told apart at ({at}): it may be dented by more "
        "than half of its thickness; give --viewpoint, or a scan with oriented normals (wall_side)"
    )


def _require_material(mesh: Mesh, face: Face) -> None:
    reason = why_unsigned(mesh)
    if reason is not None and mesh.volume <= 0.0:
        # What lies behind an open mesh that is wound inward is the gap beside the wall.
        raise DegenerateGeometryError(
            f"behind face {face.number} the mesh does not say where material is: {reason}; close it, or wind its "
            "faces outward"
        )


def _far_side(
    part: ScannedPart, feet: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Where a ray from each foot into the material leaves it: places, normals, lengths (infinite for none), faces."""
    mesh = part.mesh
    scene = RayScene(mesh.vertices, mesh.faces, mesh.centre, mesh.diagonal)
    # The ray begins below its own face: in single precision a foot may lie on either side of it.
    begin = (feet - mesh.centre) / mesh.diagonal - 1e-5 * normals
    triangles, _ = scene.first_faces(np.hstack([begin, -normals]))
    met = triangles >= 0
    outward = mesh.face_normals[np.where(met, triangles, 0)]
    corner = mesh.vertices[mesh.faces[np.where(met, triangles, 0), 0]]
    against = -np.einsum("ij,ij->i", normals, outward)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.einsum("ij,ij->i", corner - feet, outward) / against
    lengths = np.where(met & (against > 0.0), lengths, np.inf)
    far = feet - np.where(np.isfinite(lengths), lengths, 0.0)[:, None] * normals
    return far, outward, lengths, part.of_triangle[np.where(met, triangles, 0)]
