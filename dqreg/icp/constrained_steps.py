"""Steps to planes along those motions alone that the shape of a part holds.

Facets seem to hold the rotation of a round shaft, and noise turns it by a degree in each step. Its planes are those of
the feet before, from which the points have left by the square of that: the axis lay up to four standard deviations off.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.geometry.mesh_normals import smooth_normals_of
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.estimators import Estimator
from dqreg.rigid import single_pose
from dqreg.rigid.twist import scaling_by
from dqreg.solvers import Fit
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.row_sums import FREE_SHARE, MotionSums

# Points that tell whether facets may be all that holds a motion, and the information that they come to at most, as a
# share of what all points could give.
ASKED_POINTS, MAX_FACET_SHARE = 500, 0.05
# Information below this share of the largest is none.
SINGULAR_SHARE = 1e-9


def motions_of_smooth_surface(pairs: Correspondences, surface: MeshSurface, weights: FloatArray) -> FloatArray:
    """Axes of the motions that the surface holds which the facets approximate, (6, k): these hold a round shaft.

    Twists about the middle of the part with rotations as displacements at half its diagonal.
    """
    found, middle = pairs.closest, np.asarray(surface.centre, dtype=np.float64)
    smooth = smooth_normals_of(surface.mesh, found.points, found.elements, found.normals)
    columns = pairs.moved, found.normals, smooth, np.zeros(len(weights)), weights, middle
    sums = MotionSums.of(*columns, 0.5 * surface.diagonal, np.zeros(1, dtype=np.int64), np.eye(6))
    values, axes = np.linalg.eigh(sums.of_smooth())
    return np.asarray(axes[:, values >= FREE_SHARE * weights.sum()])


def motions_of_shape(pairs: Correspondences, weights: FloatArray) -> FloatArray | None:
    """The same of pairs on a part, (6, k); None where the shape holds all six, or there is no part."""
    surface = pairs.surface
    if not isinstance(surface, MeshSurface):
        return None
    # Most parts are held by some points already.
    some = sample_rows(len(weights), ASKED_POINTS)
    rows, few = _rows(pairs.moved[some], pairs.closest.normals[some], surface), weights[some]
    if np.linalg.eigvalsh((rows * few) @ rows.T)[0] > MAX_FACET_SHARE * few.sum():
        return None
    axes = motions_of_smooth_surface(pairs, surface, weights)
    return axes if axes.shape[1] < 6 else None


def planes_along(axes: FloatArray) -> Estimator:
    """Point-to-plane by Gauss-Newton, along motions of a part alone that `motions_of_shape` gives, (6, k)."""

    def estimate(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
        surface = pairs.surface
        assert isinstance(surface, MeshSurface)
        rows = product(axes.T, _rows(pairs.moved, pairs.closest.normals, surface))
        weighed, heights = rows * weights, pairs.point_to_plane
        inverse = np.linalg.pinv(product(weighed, rows.T), rcond=SINGULAR_SHARE, hermitian=True)
        step = -inverse @ product(weighed, heights[:, None])[:, 0]
        middle, D = np.asarray(surface.centre), single_pose.exp(axes @ step / scaling_by(0.5 * surface.diagonal))
        D[:3, 3] += middle - D[:3, :3] @ middle
        cost = float(product(weights[None], ((heights + step @ rows) ** 2)[:, None])[0, 0])
        return Fit(D @ pairs.T_target_source, cost, math.sqrt(cost / float(weights.sum())), math.nan)

    return estimate


def _rows(points: FloatArray, normals: FloatArray, surface: MeshSurface) -> FloatArray:
    return plane_rows(points, normals, np.asarray(surface.centre, dtype=np.float64), 0.5 * surface.diagonal)
