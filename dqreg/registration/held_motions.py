"""What both sides of some pairs say of the motions: normals of the scan, and which motions the shape holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, median, product
from dqreg.geometry import CloudSurface, MeshSurface, Surface
from dqreg.geometry.mesh_normals import smooth_normals_of
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import nonzero_rows, row_dots
from dqreg.icp import Alignment, Correspondences
from dqreg.icp.noise_by_face import motions_of_creases, weights_by_face
from dqreg.rigid import twist
from dqreg.rigid.twist import scaling_by
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust.information import held_part

# The least share of a motion that points are said to follow: of few points it is as good as chance.
LEAST_RESPONSE = 0.1
# Points that are asked how residuals follow a displacement by their usual size.
FOLLOWING_POINTS = 1_000
# Points beyond so many of these are of another face; the share of it that residuals follow at least.
SAME_FACE_SIGMAS, MIN_FOLLOWED_SHARE = 3.0, 0.05


def own_normals(surface: Surface, pairs: Correspondences) -> FloatArray | None:
    """Normals of the scan in the target's frame, (n, 3), where those of the target are estimates too."""
    if not isinstance(surface, CloudSurface) or not pairs.closest.normals.any():
        return None
    return product(pairs.scan.normals, pairs.T_target_source[:3, :3].T)


def held_by_shape(pairs: Correspondences, weights: FloatArray) -> FloatArray | None:
    """What leaves of a twist about the target's origin what the shape holds, (6, 6); None where it holds all six.

    None as well where there are no normals to tell it.
    """
    surface, found = pairs.surface, pairs.closest
    if surface is None or not found.normals.any():
        return None
    smooth, own = found.normals, own_normals(surface, pairs)
    if isinstance(surface, MeshSurface):
        smooth = smooth_normals_of(surface.mesh, found.points, found.elements, found.normals)
    return held_part(pairs.moved, found.normals, weights, 0.5 * surface.diagonal, smooth, own)


def inflation_of(run: Alignment, lever: float, beside: Callable[[FloatArray], Alignment]) -> FloatArray | None:
    """What errors of the scaled twist are multiplied with, (6, 6), where points near creases alone hold motions.

    Points that noise carries over an edge lie on the wall behind it, which no one may have seen, and points within the
    noise of both change sides as the pose moves: the pull of such a rim grows by half of what its points say, and the
    pose errs by so much more. So the derivative of the estimating equation is asked for, at poses beside. None where
    the faces hold all.
    """
    width = run.mixture.scale
    motions, whole = motions_of_creases(run.pairs, run.weights, width)
    if not motions.shape[1]:
        return None

    def pull(at: Alignment) -> tuple[FloatArray, FloatArray]:
        pairs = at.pairs
        weights = weights_by_face(pairs, at.weights, width)
        rows = motions.T @ plane_rows(pairs.moved, pairs.closest.normals, np.zeros(3), lever)
        return (rows * weights) @ pairs.point_to_plane, (rows * weights) @ rows.T

    said, found = pull(run)[1], []
    for motion in motions.T:
        length = float(np.linalg.norm(motion))
        step = width / length * motion / scaling_by(lever)
        ahead, behind = (pull(beside(twist.exp(side * step) @ run.T_target_source))[0] for side in (1.0, -1.0))
        found.append((ahead - behind) * (0.5 * length / width))
    response = np.array(found)
    values, axes = np.linalg.eigh(said)
    if not values[0] > 0.0:
        return None
    unit = axes / np.sqrt(values)
    shares, mixtures = np.linalg.eigh(0.5 * unit.T @ (response + response.T) @ unit)
    more = 1.0 / np.clip(shares, LEAST_RESPONSE, 1.0) - 1.0
    unit = unit @ mixtures
    return np.asarray(np.eye(6) + motions @ (unit * more) @ np.linalg.inv(unit) @ motions.T @ whole)


def followed_by(run: Alignment, surface: Surface) -> float:
    """Share of a displacement along the normals that residuals follow, see `Fit.followed`; 1 on a mesh."""
    pairs = run.pairs
    if not isinstance(surface, CloudSurface):
        return 1.0
    rows = np.flatnonzero((run.weights > 0.0) & nonzero_rows(pairs.closest.normals))
    if not len(rows):
        return 1.0
    rows = rows[sample_rows(len(rows), FOLLOWING_POINTS)]
    aside = np.abs(pairs.point_to_plane[rows])
    size = GAUSSIAN_MEDIAN * median(aside)
    rows = rows[aside <= SAME_FACE_SIGMAS * size]
    if not size > 0.0:
        return 1.0
    # Displaced to both sides at once.
    rows = np.concatenate([rows, rows])
    moved, found = np.take(pairs.moved, rows, axis=0), pairs.closest._taken(rows)
    steps = np.repeat([size, -size], len(rows) // 2)
    points = moved + steps[:, None] * found.normals
    closest = surface.closest(points, (moved, found))
    along = row_dots(points - closest.points, closest.normals)
    along *= np.where(row_dots(closest.normals, found.normals) < 0.0, -1.0, 1.0)
    along = np.clip(along, -SAME_FACE_SIGMAS * size, SAME_FACE_SIGMAS * size)
    share = (along[: len(rows) // 2] - along[len(rows) // 2 :]).sum() / (size * len(rows))
    return min(max(float(share), MIN_FOLLOWED_SHARE), 1.0)
