"""Points near a crease of a part, which noise may have carried to the other face.

Over an edge between a face that is seen from above and one at a slant, points of the first meet the second, where the
noise is small and each counts much: three in a thousand were a tenth of the error of a pose. Leaving out those that
stand off an edge alone would leave those that the noise has carried inwards: whatever their height, all points whose
closest place is near one are left out.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.icp.correspondences import Correspondences
from dqreg.solvers.row_sums import squared

# Faces that turn by more than that have a crease between them; kernel scales within which a place is near it.
TURN_COS, NEAR = np.cos(np.deg2rad(20.0)), 3.0
# Share of the weights beyond which the part has creases everywhere, at the scale of the noise.
MOST = 0.3
# Share of the information about a motion that may go with these points: small walls and rims hold some alone. What is
# below that share of the largest information is rounding.
HOLDS, ROUNDING = 0.1, 1e-12
# Points that are looked at in one go.
CHUNK = 4_096


def without_creases(pairs: Correspondences, weights: FloatArray, width: float) -> FloatArray:
    """Weights, (n,), with none near creases of a part, where the other points hold all motions about as well."""
    if not isinstance(pairs.surface, MeshSurface):
        return weights
    near, sums = _near(pairs, pairs.surface, weights, NEAR * width)
    own, others = sums
    if not own[0] or own[0] > MOST * (own[0] + others[0]) or _hold(squared(own[1:]), squared(others[1:])):
        return weights
    kept = weights.copy()
    kept[near] = 0.0
    return kept


def _near(
    pairs: Correspondences, surface: MeshSurface, weights: FloatArray, margin: float
) -> tuple[BoolArray, FloatArray]:
    """Which points are near a crease, (n,); weights and information of these, and of the others, (2, 22)."""
    from dqreg.kernels.creases import COLUMNS, near_creases
    from dqreg.kernels.threads import as_plain, over_chunks

    mesh, found, count = surface.mesh, pairs.closest, len(weights)
    near, sums = np.zeros(count, dtype=bool), np.zeros((max(-(-count // CHUNK), 1), COLUMNS))
    places = as_plain(pairs.moved), as_plain(found.points), found.elements, as_plain(weights)
    faces = as_plain(mesh.corners), as_plain(mesh.face_normals), mesh.face_neighbours
    lengths = as_plain(surface.centre), 0.5 * surface.diagonal, TURN_COS, margin
    over_chunks(near_creases, count, *places, *faces, *lengths, CHUNK, near, sums, chunk=CHUNK)
    return near, sums.sum(axis=0).reshape(2, -1)


def _hold(own: FloatArray, others: FloatArray) -> bool:
    """Whether some points hold a motion that the others hardly do, given the information, (6, 6), of each."""
    whole = own + others
    return bool(np.linalg.eigvalsh(own - HOLDS * whole)[-1] > ROUNDING * np.trace(whole))
