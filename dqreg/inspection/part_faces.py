"""The faces of a part as features: planes, cylinders, cones, spheres or tori, of what size, and where."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_place
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh
from dqreg.geometry.angles import gaps_around
from dqreg.geometry.mesh_faces import areas_of, faces_of
from dqreg.inspection.deviations.outward_side import wound_outward
from dqreg.inspection.features import Feature, FeatureKind, fit_feature
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.torus import Torus, fit_torus

FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "free"]

# A face is of a kind where its corners lie within that share of its size of the ideal shape: a tessellation's do.
MAX_FORM_EXTENTS = 1e-4
# Coarse files round the corners of a cylinder or cone: they may lie off by that share of what the middles of their
# sides do. Corners of another shape lie as far off as the middles, and half of their form error is more than that.
MAX_FORM_SAGITTAS = 0.75
# Single precision, in sizes of the part.
ROUNDING_DIAGONALS = 1e-6
# Corners that are fitted; more say the same.
MAX_FITTED_CORNERS = 3_000
# Corners that are asked first where there are many more, and how far beyond what is allowed their fit says that all are
# no such shape: four fits of a free face would take longer than reading it.
FIRST_CORNERS, REFUSED_FORM_RATIO = 300, 3.0
# Kinds that are tried, the simplest first.
TRIED: tuple[FeatureKind, ...] = ("plane", "cylinder", "cone", "sphere")


@dataclasses.dataclass(frozen=True, eq=False)
class Face:
    """A face of a part.

    Attributes
    ----------
    number : int
        Names it; the same for the same mesh.
    kind : {"plane", "cylinder", "cone", "sphere", "torus", "free"}
        Its shape.
    feature : Feature or None
        The ideal shape through its corners, a plane's normal outward; None where it is free or a torus.
    is_hole : bool
        Whether it surrounds empty space on more than half a turn: its normals point towards its axis or centre. False
        for a torus.
    area : float
        Of its triangles.
    centre : ndarray, (3,)
        Mean of its triangles, weighted by area.
    extent : float
        Diagonal of its bounding box.
    torus : Torus or None
        Its centre, axis and both radii where it is a torus, as fillets round a boss are.
    """

    number: int
    kind: FaceKind
    feature: Feature | None
    is_hole: bool
    area: float
    centre: FloatArray
    extent: float
    torus: Torus | None = None


def part_faces(mesh: Mesh) -> tuple[Face, ...]:
    """Faces of a part, cut where its surface turns sharply or a large plane ends.

    Parameters
    ----------
    mesh : Mesh
        The part, any unit; where it is open, wound outward for ``is_hole`` and normals.

    Returns
    -------
    tuple of Face
        By their number, from 0.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> [face.kind for face in part_faces(Mesh(*box((3.0, 2.0, 1.0))))]
    ['plane', 'plane', 'plane', 'plane', 'plane', 'plane']
    """
    count, labels = faces_of(mesh)
    areas = areas_of(mesh, labels)
    order = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels[order], np.arange(count + 1))
    outward = wound_outward(mesh)
    return tuple(_face(outward, k, order[ends[k] : ends[k + 1]], float(areas[k])) for k in range(count))


def nearest_face(mesh: Mesh, faces: tuple[Face, ...], point: ArrayLike) -> Face:
    """The face that is closest to a point.

    Parameters
    ----------
    mesh : Mesh
        The part.
    faces : tuple of Face
        From `part_faces`.
    point : array_like, (3,)
        In the part's frame.

    Returns
    -------
    Face
        Of the closest triangle.

    Raises
    ------
    InputError
        If the point is no finite place.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> nearest_face(part, part_faces(part), [0.2, 0.1, 0.6]).centre.tolist()
    [0.0, 0.0, 0.5]
    """
    from dqreg.geometry import MeshSurface

    triangle = int(MeshSurface(mesh).closest(as_place(point, "point")[None]).elements[0])
    return faces[int(faces_of(mesh)[1][triangle])]


def faces_in_box(mesh: Mesh, faces: tuple[Face, ...], box: ArrayLike) -> tuple[Face, ...]:
    """The faces that lie in a box as a whole.

    Parameters
    ----------
    mesh : Mesh
        The part.
    faces : tuple of Face
        From `part_faces`.
    box : array_like, (6,)
        Two opposite corners, x y z x y z, in the part's frame.

    Returns
    -------
    tuple of Face
        By their number; empty where there are none.

    Raises
    ------
    InputError
        If the box is not six finite coordinates.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> [face.centre.tolist() for face in faces_in_box(part, part_faces(part), [-2, -2, 0.4, 2, 2, 0.6])]
    [[0.0, 0.0, 0.5]]
    """
    ends = np.asarray(box, dtype=np.float64)
    if ends.shape != (6,) or not np.isfinite(ends).all():
        raise InputError(f"a box is six finite coordinates, two opposite corners; got {box!r:.80}")
    low, high = np.minimum(ends[:3], ends[3:]), np.maximum(ends[:3], ends[3:])
    # A corner in single precision may lie beside the plane that it was meant for.
    margin = ROUNDING_DIAGONALS * mesh.diagonal
    inside = ((mesh.corners >= low - margin) & (mesh.corners <= high + margin)).all(axis=(1, 2))
    out = np.bincount(faces_of(mesh)[1], weights=~inside, minlength=len(faces))
    return tuple(face for face in faces if not out[face.number])


def face_sides(mesh: Mesh, labels: IntArray) -> tuple[IntArray, FloatArray]:
    """Sides of triangles at which a face of the part ends: triangle and both ends. Shapes: (m,), (m, 2, 3)."""
    sides = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    own, other = np.repeat(np.arange(len(mesh.faces)), 3), mesh.face_neighbours.reshape(-1)
    border = np.flatnonzero((labels[own] != labels[other]) | (own == other))
    ends = mesh.vertices[sides[border]]
    whole = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 0.0
    return own[border[whole]], ends[whole]


def feet_on(ends: FloatArray, place: FloatArray) -> FloatArray:
    """Nearest point of each segment to a place. Shapes: (m, 2, 3), (3,), returns (m, 3)."""
    along = ends[:, 1] - ends[:, 0]
    share = np.clip(np.einsum("ij,ij->i", place - ends[:, 0], along) / np.einsum("ij,ij->i", along, along), 0.0, 1.0)
    return np.asarray(ends[:, 0] + share[:, None] * along)


def faces_at(mesh: Mesh, place: FloatArray) -> tuple[int, ...]:
    """Numbers of the faces that the nearest place of the part is on: more than one at an edge."""
    from dqreg.geometry import MeshSurface

    found, labels = MeshSurface(mesh).closest(place[None]), faces_of(mesh)[1]
    own, ends = face_sides(mesh, labels)
    away = np.linalg.norm(feet_on(ends, found.points[0]) - found.points[0], axis=1)
    beside = own[away <= ROUNDING_DIAGONALS * mesh.diagonal]
    return tuple(sorted({int(labels[found.elements[0]]), *labels[beside].tolist()}))


def _face(mesh: Mesh, number: int, rows: IntArray, area: float) -> Face:
    corners, normals = mesh.corners[rows], mesh.face_normals[rows]
    sizes = mesh.face_areas[rows]
    centre: FloatArray = (corners.mean(axis=1) * sizes[:, None]).sum(axis=0) / max(float(sizes.sum()), 1e-300)
    extent = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    feature = _feature_of(corners, normals, extent)
    kind: FaceKind = "free"
    is_hole = False
    torus = None
    if feature is None or feature.form > MAX_FORM_EXTENTS * extent:
        # Corners that are on no other shape, or only as those of a coarse file are.
        torus = _torus_of(corners, normals, extent)
    if torus is not None:
        kind, feature = "torus", None
    if feature is not None:
        kind = feature.kind  # type: ignore[assignment]
        if kind != "plane":
            is_hole = _faces_inward(feature, corners.mean(axis=1), normals, sizes)
    return Face(number, kind, feature, is_hole, area, centre, extent, torus)


def _feature_of(corners: FloatArray, normals: FloatArray, extent: float) -> Feature | None:
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3)
    points, sides = corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)
    step = -(-len(points) // MAX_FITTED_CORNERS)
    points, sides, middles = points[::step], sides[::step], middles[::step]
    if len(points) < 6:
        # One triangle, or what is left of one: a plane of three corners has no form error to judge.
        points, sides = np.vstack([points, points.mean(axis=0)]), np.vstack([sides, sides[:1]])
    few = slice(None, None, max(1, len(points) // FIRST_CORNERS))
    coarse: Feature | None = None
    for kind in TRIED:
        if coarse is not None and kind == "sphere":
            break
        try:
            if len(points) > 4 * FIRST_CORNERS:
                asked = fit_feature(points[few], kind, normals=sides[few])
                if asked.form > REFUSED_FORM_RATIO * _allowed(asked, middles, extent):
                    continue
            found = fit_feature(points, kind, normals=sides)
        except DegenerateGeometryError:
            continue
        if found.form <= MAX_FORM_EXTENTS * extent:
            return found
        # As those of a coarse file, unless another shape holds them exactly: two rims of a cone are near a cylinder
        # across it, whose chords are as long as they are wide.
        if coarse is None and found.form <= _allowed(found, middles, extent):
            coarse = found
    return coarse


def _torus_of(corners: FloatArray, normals: FloatArray, extent: float) -> Torus | None:
    few = slice(None, None, max(1, 3 * len(corners) // FIRST_CORNERS))
    form = MAX_FORM_EXTENTS * extent
    if (
        3 * len(corners) > 4 * FIRST_CORNERS
        and fit_torus(corners[few], normals[few], REFUSED_FORM_RATIO * form) is None
    ):
        return None
    chosen = slice(None, None, -(-3 * len(corners) // MAX_FITTED_CORNERS))
    return fit_torus(corners[chosen], normals[chosen], form)


def _allowed(found: Feature, middles: FloatArray, extent: float) -> float:
    """Form error that the corners of a tessellated face may have; sides of a round one cut their chords anyway."""
    if found.kind not in ("cylinder", "cone"):
        # Two rims of a wall are on a sphere too, whose chords are as long as the wall is high.
        return MAX_FORM_EXTENTS * extent
    sagitta = float(np.abs(distances(found.kind, found.shape, middles)[0]).max())
    return max(MAX_FORM_EXTENTS * extent, MAX_FORM_SAGITTAS * sagitta)


def _faces_inward(feature: Feature, points: FloatArray, normals: FloatArray, weights: FloatArray) -> bool:
    offsets = points - feature.point
    if feature.kind != "sphere":
        offsets = offsets - (offsets @ feature.axis)[:, None] * feature.axis
    if float(weights @ np.einsum("ij,ij->i", offsets, normals)) >= 0.0:
        return False
    if feature.kind == "sphere":
        return True
    # A concave fillet surrounds its axis on less than half a turn.
    angles = np.arctan2(offsets @ feature.frame[:, 1], offsets @ feature.frame[:, 0])
    return bool(gaps_around(angles)[1].max() < np.pi)
