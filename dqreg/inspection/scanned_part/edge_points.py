"""The edge of a part beside a place, and where the scan has it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_place
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.features import Feature, fit_feature
from dqreg.inspection.features.edge import STRIP_WIDTH_SPACINGS, EdgePoint, border_offset, meeting_point
from dqreg.inspection.part_faces import Face, face_sides, feet_on
from dqreg.inspection.scanned_part.scanned_part import CUT_SIGMAS, ScannedPart, outlier_cut

# Scan points within so many usual spacings of the place are taken, where no radius is given.
REACH_SPACINGS = 12.0
# A place farther than that share of the part's size from every edge names none.
MAX_OFF_EDGE_DIAGONALS = 0.02
# What lies beyond a border is joined to the sheet where its points are no farther apart.
JOINED_SPACINGS = 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class NominalEdge:
    """An edge of the part itself beside a place."""

    point: FloatArray  # (3,): On the edge, nearest to the place
    direction: FloatArray  # (3,)
    faces: tuple[int, ...]  # On both sides of it; one at a border
    normals: FloatArray  # (faces, 3): Outward
    outward: FloatArray  # (faces, 3): Within each face, across the edge, away from its material

    def turned(self) -> NominalEdge:
        """The same with its faces the other way round."""
        return NominalEdge(self.point, self.direction, self.faces[::-1], self.normals[::-1], self.outward[::-1])


def edge_point(
    deviations: Deviations, point: ArrayLike, *, face: int | None = None, radius: float | None = None
) -> EdgePoint:
    """Measure an edge of a part where the scan has it.

    Between two faces: planes by least squares through the scan points on each, beside the place, meet. At the border of
    an open sheet: a least squares line along the outermost points, put right by what outermost points are short of
    borders inside the sheet. On a curved face its shape is taken off first.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh.
    point : array_like, (3,)
        Near the edge, in the caller's target frame; the nearest place of an edge is measured.
    face : int, optional
        The face that the offset is measured in. Default: the larger one of the two.
    radius : float, optional
        Scan points within it are taken, target units. Default: 12 usual spacings of the scan.

    Returns
    -------
    EdgePoint
        In the caller's target frame.

    Raises
    ------
    InputError
        If the target is no mesh, or no edge lies near the point, or the face is not beside it.
    DegenerateGeometryError
        If the faces were not scanned there, or meet at less than 10 degrees.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, MeshSurface, sample_mesh
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> scan = sample_mesh(part, 9_000, np.random.default_rng(0)).points
    >>> scan[scan[:, 2] > 0.499999, 2] += 0.01
    >>> found = edge_point(measure_deviations(scan, part, MeshSurface(part)), [1.5, 0.0, 0.5])
    >>> found.kind, (found.point - [1.5, 0.0, 0.5]).round(6).tolist()
    ('meeting', [0.0, 0.0, 0.01])
    """
    part = ScannedPart.of(deviations)
    found = edge_on(part, as_place(point, "point") - part.origin, face=face, radius=radius)
    return dataclasses.replace(found, point=found.point + part.origin, nominal=found.nominal + part.origin)


def edge_on(part: ScannedPart, place: FloatArray, *, face: int | None = None, radius: float | None = None) -> EdgePoint:
    """An edge of a scanned part, about the part's middle; see `edge_point`."""
    if radius is not None and not 0.0 < radius < np.inf:
        raise InputError(f"radius must be a length above 0; got {radius!r}")
    edge = edge_beside(part, place, face)
    reach = REACH_SPACINGS * part.spacing if radius is None else radius
    return _meeting(part, edge, reach) if len(edge.faces) == 2 else _border(part, edge, reach)


def edge_beside(part: ScannedPart, place: FloatArray, face: int | None) -> NominalEdge:
    """The edge of the part that is nearest to a place; the face that is named, or the larger one, is its first."""
    edge = nominal_edge(part, place)
    if face is not None and face not in edge.faces:
        beside = " and ".join(map(str, edge.faces))
        raise InputError(f"face {face} does not end at the edge there; faces {beside} do")
    areas = [part.faces[number].area for number in edge.faces]
    first = int(np.argmax(areas)) if face is None else edge.faces.index(face)
    return edge if first == 0 else edge.turned()


def nominal_edge(part: ScannedPart, place: FloatArray) -> NominalEdge:
    """The edge of the part that is nearest to a place, with the faces on its sides."""
    mesh, labels = part.mesh, part.of_triangle
    own, ends = face_sides(mesh, labels)
    if not len(own):
        raise InputError("the part has no edges: it is smooth everywhere")
    along = ends[:, 1] - ends[:, 0]
    feet = feet_on(ends, place)
    away = np.linalg.norm(feet - place, axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] > MAX_OFF_EDGE_DIAGONALS * mesh.diagonal:
        at = ", ".join(f"{x:.6g}" for x in feet[nearest] + part.origin)
        raise InputError(f"no edge lies near the point: the nearest place of one is ({at})")
    # Both triangles at the side have it, each once.
    same = np.flatnonzero(away <= away[nearest] + 1e-7 * mesh.diagonal)
    parallel = np.abs(np.cross(along[same], along[nearest])).max(axis=1) <= 1e-6 * float(
        along[nearest] @ along[nearest]
    )
    rows = own[same[parallel]]
    triangles = [int(own[nearest]), *(int(k) for k in rows if labels[k] != labels[own[nearest]])][:2]
    direction = along[nearest] / np.linalg.norm(along[nearest])
    normals = mesh.face_normals[triangles]
    across = np.cross(direction, normals)
    inner = mesh.corners[triangles].mean(axis=1) - feet[nearest]
    across = np.where(np.einsum("ij,ij->i", across, inner)[:, None] > 0.0, -across, across)
    return NominalEdge(feet[nearest], direction, tuple(int(labels[k]) for k in triangles), normals, across)


def _meeting(part: ScannedPart, edge: NominalEdge, radius: float) -> EdgePoint:
    planes = []
    for k in (0, 1):
        face = part.faces[edge.faces[k]]
        rows = part.rows_on(face)
        flat = _flattened(part, edge, k, rows[np.linalg.norm(part.points[rows] - edge.point, axis=1) <= radius])
        _require_scanned(part, face, len(flat), 0.5 * np.pi * radius**2)
        sides = np.broadcast_to(edge.normals[k], flat.shape)
        planes.append(fit_feature(flat, "plane", normals=sides, cut=outlier_cut(flat)))
    met, covariance = meeting_point(planes[0], planes[1], edge.point, edge.direction)
    return EdgePoint(
        kind="meeting",
        point=met,
        nominal=edge.point,
        direction=edge.direction,
        outward=edge.outward[0],
        covariance=covariance,
        points=sum(plane.points for plane in planes),
        faces=edge.faces,
    )


def _border(part: ScannedPart, edge: NominalEdge, radius: float) -> EdgePoint:
    face = part.faces[edge.faces[0]]
    # The strip reaches as far inward as it is long: beyond the border lies what is too long.
    rows = np.flatnonzero(part.face_of_points == face.number)
    rows = rows[np.abs(part.points[rows] - edge.point).max(axis=1) <= 2.0 * radius]
    flat = _flattened(part, edge, 0, rows)
    along, across = (flat - edge.point) @ edge.direction, (flat - edge.point) @ edge.outward[0]
    near = (np.abs(along) <= radius) & (np.abs(across) <= radius)
    _require_scanned(part, face, int(near.sum()), 2.0 * radius**2)
    sides = np.broadcast_to(edge.normals[0], flat[near].shape)
    plane = fit_feature(flat[near], "plane", normals=sides, cut=CUT_SIGMAS)
    spacing = radius * float(np.sqrt(2.0 / near.sum()))
    lip = _lip(part, edge, plane, flat[near], spacing)
    lip = lip[np.abs((lip - edge.point) @ edge.direction) <= radius]
    ends = np.vstack([flat[near], lip]) - edge.point
    offset, sigma = border_offset(ends @ edge.direction, ends @ edge.outward[0], spacing)
    if offset > radius - STRIP_WIDTH_SPACINGS * spacing:
        raise DegenerateGeometryError(
            f"face {face.number} is longer than the part by more than {radius:.4g}, as far as was looked: give a "
            "larger radius"
        )
    axis, outward = plane.axis, edge.outward[0]
    away = np.array([axis @ (plane.point - edge.point), offset, 0.0])
    at = edge.point + np.linalg.solve(np.stack([axis, outward, edge.direction]), away)
    covariance = sigma**2 * np.outer(outward, outward) + plane.sigma("shift_z") ** 2 * np.outer(axis, axis)
    return EdgePoint(
        kind="border",
        point=at,
        nominal=edge.point,
        direction=edge.direction,
        outward=outward,
        covariance=covariance,
        points=len(ends),
        faces=edge.faces,
    )


def _lip(part: ScannedPart, edge: NominalEdge, plane: Feature, sheet: FloatArray, spacing: float) -> FloatArray:
    """Scan points by which a sheet is longer than the part: beyond the border, in its plane, and joined to it, (k, 3).

    They lie off the part and are few, so that they count for nothing else.
    """
    from scipy.spatial import cKDTree

    radius = float(np.abs((sheet - edge.point) @ edge.outward[0]).max()) + spacing
    near = part._beside[np.abs(part._beside - edge.point).max(axis=1) <= 2.0 * radius]
    across, height = (near - edge.point) @ edge.outward[0], (near - plane.point) @ plane.axis
    left = near[(across > 0.0) & (across <= radius) & (np.abs(height) <= CUT_SIGMAS * plane.rms)]
    joined, found = sheet, np.zeros((0, 3))
    while len(left) and len(joined):
        reached = cKDTree(joined).query(left)[0] <= JOINED_SPACINGS * spacing
        joined, left = left[reached], left[~reached]
        found = np.vstack([found, joined])
    return found


def _flattened(part: ScannedPart, edge: NominalEdge, k: int, rows: IntArray) -> FloatArray:
    """Points on the plane of the face at the edge, their deviations as heights; those of a flat face as they are."""
    face = part.faces[edge.faces[k]]
    if face.kind == "plane":
        return part.points[rows]
    feet, _, values = part.deviations()
    flat = feet[rows] - ((feet[rows] - edge.point) @ edge.normals[k])[:, None] * edge.normals[k]
    return np.asarray(flat + values[rows, None] * edge.normals[k])


def _require_scanned(part: ScannedPart, face: Face, count: int, area: float) -> None:
    usual = min(area, face.area) / part.spacing**2
    if count < max(0.15 * usual, 12.0):
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned at the edge: {count} points lie there where {usual:.0f} are expected"
        )
