"""What both sides of some pairs say of the motions: normals of the scan, and which motions the shape holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.geometry import CloudSurface, MeshSurface, Surface
from dqreg.geometry.mesh_normals import smooth_normals_of
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
    held = motions_of_creases(run.pairs, run.weights, width)
    if held is None:
        return None
    motions = held.alone

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
    # The others have less to go by than all points together.
    further = held.beside * (1.0 / np.sqrt(held.left) - 1.0) @ held.beside.T
    return np.asarray(np.eye(6) + (motions @ (unit * more) @ np.linalg.inv(unit) @ motions.T + further) @ held.whole)


def followed_by(run: Alignment, surface: Surface) -> float:
    """Share of a displacement along the normals that residuals follow, see `Fit.followed`; 1 on a mesh."""
    from dqreg.kernels.steps.displaced_rows import displaced_rows, followed_share
    from dqreg.kernels.threads import as_plain

    pairs = run.pairs
    if not isinstance(surface, CloudSurface):
        return 1.0
    weights, moved, at = as_plain(run.weights), as_plain(pairs.moved), pairs.closest
    rows, points = np.zeros(2 * FOLLOWING_POINTS, dtype=np.int64), np.zeros((2 * FOLLOWING_POINTS, 3))
    # Displaced to both sides at once.
    known = weights, moved, as_plain(at.points), as_plain(at.normals)
    count, size = displaced_rows(*known, GAUSSIAN_MEDIAN, SAME_FACE_SIGMAS, rows, points)
    if not count:
        return 1.0
    rows, points = rows[: 2 * count], points[: 2 * count]
    found = at._taken(rows)
    closest = surface.closest(points, (np.take(moved, rows, axis=0), found))
    share = followed_share(points, closest.points, closest.normals, found.normals, size, SAME_FACE_SIGMAS)
    return min(max(share, MIN_FOLLOWED_SHARE), 1.0)
