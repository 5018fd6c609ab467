"""Points near a crease of a part, which noise may have carried to the other face.

Over an edge between a face that is seen from above and one at a slant, points of the first meet the second, where the
noise is small and each counts much: three in a thousand were a tenth of the error of a pose. Leaving out those that
stand off an edge alone would leave those that the noise has carried inwards: whatever their height, all points whose
closest place is near one are left out.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, product
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.solvers.quadratic import plane_rows

# Faces that turn by more than that have a crease between them; kernel scales within which a place is near it.
TURN_COS, NEAR = np.cos(np.deg2rad(20.0)), 3.0
# Share of the weights beyond which the part has creases everywhere, at the scale of the noise.
MOST = 0.3
# Share of the information about a motion that may go with these points: small walls and rims hold some alone.
HOLDS = 0.1
# Points that tell how well the others hold the motions; points that are looked at in one go.
SAMPLE, CHUNK = 20_000, 16_384


def without_creases(pairs: Correspondences, weights: FloatArray, width: float) -> FloatArray:
    """Weights, (n,), with none near creases of a part, where the other points hold all motions about as well."""
    if not isinstance(pairs.surface, MeshSurface):
        return weights
    near = _near(pairs, pairs.surface, weights, NEAR * width)
    rows = np.flatnonzero(near)
    if not len(rows) or weights[rows].sum() > MOST * weights.sum() or _hold(pairs, weights, rows, near):
        return weights
    kept = weights.copy()
    kept[rows] = 0.0
    return kept


def _near(pairs: Correspondences, surface: MeshSurface, weights: FloatArray, margin: float) -> BoolArray:
    from dqreg.kernels.creases import near_creases
    from dqreg.kernels.threads import as_plain, over_chunks

    mesh, found, near = surface.mesh, pairs.closest, np.zeros(len(weights), dtype=bool)
    places = as_plain(found.points), found.elements, as_plain(weights)
    faces = as_plain(mesh.corners), as_plain(mesh.face_normals), mesh.face_neighbours
    over_chunks(near_creases, len(weights), *places, *faces, TURN_COS, margin, near, chunk=CHUNK)
    return near


def _hold(pairs: Correspondences, weights: FloatArray, rows: IntArray, near: BoolArray) -> bool:
    """Whether some rows hold a motion that the others hardly do."""
    others = np.flatnonzero((weights > 0.0) & ~near)
    if not len(others):
        return True
    few, some = others[sample_rows(len(others), SAMPLE)], rows[sample_rows(len(rows), SAMPLE)]
    centre = np.take(pairs.moved, few, axis=0).mean(axis=0)
    arms = np.take(pairs.moved, few, axis=0) - centre
    lever = float(np.sqrt(np.einsum("ij,ij->", arms, arms) / len(few)))
    own = _information(pairs, weights, some, centre, lever) * (weights[rows].sum() / weights[some].sum())
    whole = own + _information(pairs, weights, few, centre, lever) * (weights[others].sum() / weights[few].sum())
    values, vectors = np.linalg.eigh(whole)
    held = values > np.finfo(float).eps * values[-1]
    scaled = vectors[:, held] / np.sqrt(values[held])
    return bool(held.any()) and bool(np.linalg.eigvalsh(scaled.T @ own @ scaled)[-1] > HOLDS)


def _information(
    pairs: Correspondences, weights: FloatArray, rows: IntArray, centre: FloatArray, lever: float
) -> FloatArray:
    points, normals = (np.take(x, rows, axis=0) for x in (pairs.moved, pairs.closest.normals))
    columns = plane_rows(points, normals, centre, lever)
    return product(columns * weights[rows], columns.T)
