"""Weights by the scatter of faces.

A range sensor's noise lies along its ray, so that a face seen at a slant scatters less across itself than one seen
from above: by the cosine between its normal and the ray. The position of the sensor is not known, but the scatter of
each face is, and where several views are merged one after the other, that of each part of the scan on it: the variance
is estimated from the distances of these points, and they are weighted by one over it (feasible generalised least
squares). Few points say little: a face begins with the variance of all faces with its orientation, and a part of the
scan on it with the face's.

Where nothing holds a motion (a shaft in its bore), weights of few points that are learned anew in each iteration push
a part to and fro along it for ever. So faces, parts of the scan and creases have their say in one last step; in the
loop all points of a part count alike, and on a cloud those with one orientation share a variance.

Over an edge between a face that is seen from above and one at a slant, points of the first meet the second, where the
noise is small and each counts much: three in a thousand were a tenth of the error of a pose. Leaving out those that
stand off an edge alone would leave those that the noise has carried inwards: whatever their height, all points whose
closest place is near a crease are left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._records import remember, remembered
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.scan_measures import CLOUD_PARTS
from dqreg.icp.constrained_steps import motions_of_smooth_surface, planes_along
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.estimators import points_to_planes
from dqreg.solvers import Fit
from dqreg.solvers.row_sums import squared

# From correspondences, weights and a kernel scale to other weights.
Weigher = Callable[[Correspondences, FloatArray, float], FloatArray]

# Cells along each axis of the cube that the normals lie in: normals of one cell differ by six degrees or so.
CELLS_PER_AXIS = 20
# Correspondences of usual variance that each cell is given beforehand, of the cell's variance each face, and of the
# face's each part of the scan on it. Chance takes 0.4 % of the efficiency then at most; of neighbours that share their
# noise, many are needed to tell as much.
CELL_PRIOR_PAIRS, FACE_PRIOR_PAIRS = 8.0, 128.0
# So many that faces say nothing beside their orientation.
ENDLESS_PRIOR_PAIRS = 1e30
# A kernel scale beyond so many times the scan's own noise measures the misfit, not the scatter of faces.
MISFIT_NOISE_RATIO = 5.0
# The least variance, as a fraction of the usual one.
MIN_VARIANCE_RATIO = 0.01
# Numbers of parts: of a scan, and that of points of several. Scans whose order tells nothing are of one.
PART_NUMBERS = CLOUD_PARTS + 1
ONE_PART = np.zeros(0, dtype=np.uint8)
# Faces that have sums of their own at most, and points for each at least: of more, those with one orientation share
# theirs.
MAX_FACES, MIN_POINTS_PER_FACE = 100_000, 4
# Faces that turn by more than that have a crease between them; kernel scales within which a place is near it.
CREASE_COS, CREASE_SCALES = np.cos(np.deg2rad(20.0)), 3.0
# Share of the information about a motion that may go with these points: small walls and rims hold some alone, as where
# creases are everywhere at the scale of the noise. What is below that share of the largest information is rounding.
ALONE_SHARE, RELATIVE_ROUNDING = 0.5, 1e-12
# Points that are looked at in one go.
CHUNK_POINTS = 4_096


def relative_precisions(
    squares: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    faces: IntArray,
    parts: NDArray[np.uint8] = ONE_PART,
    *,
    before_faces: float = FACE_PRIOR_PAIRS,
) -> FloatArray:
    """Weights, (n,), over the variance of the heights of points over their planes: that of their face and part.

    The weighted mean of the factors is one. Shapes: squares of the heights (n,), normals (n, 3), faces and parts (n,).
    """
    from dqreg.kernels.steps.face_scatter import face_precisions, face_sums, orientation_cells, times_precisions
    from dqreg.kernels.threads import as_plain, over_chunks

    count, found, cells, normals = len(weights), weights.copy(), (CELLS_PER_AXIS + 1) ** 3, as_plain(normals)
    own = int(faces.max(initial=0)) + 1
    if own > min(weights.sum() / MIN_POINTS_PER_FACE, MAX_FACES):
        faces = np.zeros(count, dtype=np.int64)
        over_chunks(orientation_cells, count, normals, CELLS_PER_AXIS, faces, chunk=CHUNK_POINTS)
        # Few of the cells hold any: sums of all would take longer to clear than to add to.
        numbers = np.zeros(cells, dtype=np.int64)
        numbers[faces] = 1
        np.cumsum(numbers, out=numbers)
        faces, own = numbers[faces] - 1, int(numbers[-1])
    sums, rows, precisions = np.zeros((own, PART_NUMBERS, 2)), np.zeros(own, np.int64), np.ones((own, PART_NUMBERS))
    face_sums(squares, found, faces, parts, sums, rows)
    limits = CELL_PRIOR_PAIRS, before_faces, MIN_VARIANCE_RATIO
    face_precisions(sums, rows, normals, CELLS_PER_AXIS, np.zeros((cells, 2)), *limits, precisions)
    over_chunks(times_precisions, count, faces, parts, precisions, found, chunk=CHUNK_POINTS)
    return found


def weights_by_orientation(pairs: Correspondences, weights: FloatArray, noise: float) -> FloatArray:
    """On a cloud, weights times the precision of all points with one orientation; unchanged beyond the noise."""
    if noise > MISFIT_NOISE_RATIO * pairs.scan.noise or isinstance(pairs.surface, MeshSurface):
        return weights
    found = pairs.closest
    asked = _square_heights(pairs, weights), found.normals, weights, found.elements
    return relative_precisions(*asked, before_faces=ENDLESS_PRIOR_PAIRS)


def weights_by_face(pairs: Correspondences, weights: FloatArray, noise: float) -> FloatArray:
    """The same; on a mesh those times the precision of each face and part of the scan, and none near creases."""
    if noise > MISFIT_NOISE_RATIO * pairs.scan.noise or not isinstance(pairs.surface, MeshSurface):
        return weights_by_orientation(pairs, weights, noise)
    # The covariance asks again for what the last step was weighed with.
    known: tuple[FloatArray, FloatArray] | None = remembered(pairs, "_by_face")
    if known is None or known[0] is not weights:
        parts = ONE_PART if pairs.scan.parts is None else pairs.scan.parts
        kept, found = without_creases(pairs, weights, noise), pairs.closest
        squares = _square_heights(pairs, kept)
        known = weights, relative_precisions(squares, found.normals, kept, found.elements, parts)
        remember(pairs, _by_face=known)
    return known[1]


def _square_heights(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    from dqreg.kernels.steps.face_scatter import NOTHING, square_heights
    from dqreg.kernels.threads import as_plain, over_chunks

    found, scatter, squares = pairs.closest, pairs.scan.scatter, np.zeros(len(weights))
    columns = [as_plain(x) for x in (pairs.moved, found.points, found.normals, weights)]
    spread = as_plain(scatter) if isinstance(scatter, np.ndarray) else NOTHING
    over_chunks(square_heights, len(weights), *columns, spread, squares, chunk=CHUNK_POINTS)
    return squares


def points_to_weighted_planes(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Point-to-plane, on a cloud each orientation weighted by its own scatter; near the answer only."""
    return points_to_planes(pairs, weights_by_orientation(pairs, weights, noise), noise)


def points_to_weighted_faces(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    """Point-to-plane, each face weighted by its own scatter; for one last step.

    Where points near creases hold some motions alone, they have no say in the others.
    """
    weighed, held = weights_by_face(pairs, weights, noise), motions_of_creases(pairs, weights, noise)
    if held is None or not held.beside.size:
        return points_to_planes(pairs, weighed, noise)
    by_all = planes_along(held.alone)(pairs, weighed, noise)
    by_others = planes_along(held.beside)(pairs, np.where(held.others, weighed, 0.0), noise)
    # Not by the transpose: rounding would grow threefold with each run that goes on from the last one.
    both = by_all.T_target_source @ np.linalg.inv(pairs.T_target_source) @ by_others.T_target_source
    return dataclasses.replace(by_all, T_target_source=both)


def without_creases(pairs: Correspondences, weights: FloatArray, width: float) -> FloatArray:
    """Weights, (n,), with none near creases of a part, where the other points hold all motions about as well."""
    found = _creases(pairs, weights, width)
    if found is None or _constrain(found.own, found.others):
        return weights
    kept = weights.copy()
    kept[found.near] = 0.0
    return kept


@dataclasses.dataclass(frozen=True, eq=False)
class HeldByCreases:
    """Motions of a part of which points near creases hold some and the others hardly do; of information one each.

    Twists about the middle of the part with rotations as displacements at half its diagonal.
    """

    alone: FloatArray  # (6, m): Those that these hold
    beside: FloatArray  # (6, k): Those that the others hold as well
    left: FloatArray  # (k,): What the others have of the information of these
    whole: FloatArray  # (6, 6): The information of all
    others: BoolArray  # (n,): Which points are not near creases


def motions_of_creases(pairs: Correspondences, weights: FloatArray, width: float) -> HeldByCreases | None:
    """Motions that points near creases hold and the others hardly do; None where there are none."""
    found = _creases(pairs, weights, width)
    if found is None or not _constrain(found.own, found.others):
        return None
    axes, whole = motions_of_smooth_surface(pairs, found.surface, weights), found.own + found.others
    values, turned = np.linalg.eigh(axes.T @ whole @ axes)
    known = values > RELATIVE_ROUNDING * values.sum()
    unit = axes @ turned[:, known] / np.sqrt(values[known])
    shares, mixtures = np.linalg.eigh(unit.T @ found.own @ unit)
    unit, alone = unit @ mixtures, shares > ALONE_SHARE
    if not alone.any():
        return None
    return HeldByCreases(unit[:, alone], unit[:, ~alone], 1.0 - shares[~alone], whole, ~found.near)


@dataclasses.dataclass(frozen=True, eq=False)
class _Creases:
    """Points near creases of a part, where there are some and not too many."""

    surface: MeshSurface
    near: BoolArray  # (n,): Which points
    own: FloatArray  # (6, 6): Their information
    others: FloatArray  # (6, 6): That of the other points


def _creases(pairs: Correspondences, weights: FloatArray, width: float) -> _Creases | None:
    # The last step, the loop on rims and the covariance ask for the same.
    known: tuple[FloatArray, float, _Creases | None] | None = remembered(pairs, "_creases")
    if known is None or known[0] is not weights or known[1] != width:
        found, surface = None, pairs.surface
        if isinstance(surface, MeshSurface):
            near, ((own_weight, *own), (_, *others)) = _near(pairs, surface, weights, CREASE_SCALES * width)
            if own_weight > 0.0:
                found = _Creases(surface, near, squared(np.array(own)), squared(np.array(others)))
        known = weights, width, found
        remember(pairs, _creases=known)
    return known[2]


def _near(
    pairs: Correspondences, surface: MeshSurface, weights: FloatArray, margin: float
) -> tuple[BoolArray, FloatArray]:
    """Which points are near a crease, (n,); weights and information of these, and of the others, (2, 22)."""
    from dqreg.kernels.meshes.creases import COLUMNS, near_creases
    from dqreg.kernels.threads import as_plain, over_chunks

    mesh, found, count = surface.mesh, pairs.closest, len(weights)
    near, sums = np.zeros(count, dtype=bool), np.zeros((max(-(-count // CHUNK_POINTS), 1), COLUMNS))
    places = as_plain(pairs.moved), as_plain(found.points), found.elements, as_plain(weights)
    faces = as_plain(mesh.corners), as_plain(mesh.face_normals), mesh._fans.find(found.elements).turns
    lengths = as_plain(surface.centre), 0.5 * surface.diagonal, CREASE_COS, margin
    over_chunks(near_creases, count, *places, *faces, *lengths, CHUNK_POINTS, near, sums, chunk=CHUNK_POINTS)
    return near, sums.sum(axis=0).reshape(2, -1)


def _constrain(own: FloatArray, others: FloatArray) -> bool:
    """Whether some points hold a motion that the others hardly do, given the information, (6, 6), of each."""
    whole = own + others
    return bool(np.linalg.eigvalsh(own - ALONE_SHARE * whole)[-1] > RELATIVE_ROUNDING * np.trace(whole))
