"""Noise of a scan, from what its points leave of planes and quadrics fitted to their neighbours.

What 16 neighbours leave of their plane is noise on a dense scan; on a sparse one it is the curvature of the faces and
the edges between them, up to eighty times the noise. Quadrics follow the curvature, and where they leave least there is
no edge. Where the noise is the same all over, both agree.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NEIGHBOURS, PlaneFits, sample_rows

# Neighbourhoods in which quadrics are fitted; fewer than the least tell nothing.
FITTED, FEWEST = 400, 40
# Coefficients of a height over two coordinates, up to squares.
COEFFICIENTS = 6
# Neighbours along one ring of a LiDAR lie in the plane of its laser, round a corner too, which says nothing of the
# noise: their least spread is below this share of the largest. Of 64 scans by cameras 98 % of the neighbourhoods were
# wider at least, of rings down to 58 %; so many have to be.
ROUND, MOST = 0.3, 0.9
# Edges and curvature leave a tenth of the spacing of the points and more; what is far below is noise.
FAR_BELOW = 0.05
# Quantile of what quadrics leave, and what that is of the standard deviation where all of it is Gaussian noise: the
# root of the chi-squared quantile over its 10 degrees of freedom.
QUIET, OF_SIGMA = 0.25, 0.8208
# Faces that the sensor sees at a slant scatter less across themselves: the quiet ones are quieter than most by this.
SLANTED = 1.2


def noise_of(
    fits: PlaneFits, points: FloatArray, at: FloatArray, tree: NeighbourTree, spacing: float
) -> tuple[float, float]:
    """Standard deviation of points across their faces: what most planes leave, and quadrics on the quieter faces.

    Shapes: points (n, 3) of the tree, at (m, 3), where planes are fitted.
    """
    known = np.flatnonzero(fits.known)
    if not len(known):
        return 0.0, 0.0
    planes = median(fits.residuals[known])
    rows = known[sample_rows(len(known), FITTED)]
    if len(rows) < FEWEST or fits.count < NEIGHBOURS or not planes > FAR_BELOW * spacing:
        return planes, planes
    indices, _ = tree.nearest(at[rows], NEIGHBOURS)
    left = _quadric_residuals(np.take(points, indices, axis=0), fits.normals[rows])
    if len(left) < MOST * len(rows):
        return planes, planes
    return planes, min(planes, SLANTED * float(np.quantile(left, QUIET)) / OF_SIGMA)


def _quadric_residuals(neighbours: FloatArray, normals: FloatArray) -> FloatArray:
    """Root mean square of what neighbours, (m, k, 3), leave of a quadric over their plane, of those in no profile."""
    away = neighbours - neighbours.mean(axis=1, keepdims=True)
    # Any direction across the normal: its least axis, made perpendicular.
    first = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first -= np.einsum("mi,mi->m", first, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frames = np.stack([first, np.cross(normals, first), normals], axis=2)
    u, v, height = np.moveaxis(away @ frames, 2, 0)
    uu, vv, uv = np.mean(u * u, axis=1), np.mean(v * v, axis=1), np.mean(u * v, axis=1)
    # The least variance of the two over the largest, from sum and product.
    total, product = uu + vv, uu * vv - uv * uv
    is_round = 4.0 * product > total**2 * (1.0 - ((1.0 - ROUND**2) / (1.0 + ROUND**2)) ** 2)
    size = np.sqrt(total[is_round, None])
    u, v, height = u[is_round] / size, v[is_round] / size, height[is_round]
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    # On two lines the square across them is not determined: the ridge leaves it at zero.
    normal = terms.transpose(0, 2, 1) @ terms + 1e-9 * np.eye(COEFFICIENTS)
    found = np.linalg.solve(normal, terms.transpose(0, 2, 1) @ height[..., None])
    left = height - (terms @ found)[..., 0]
    residuals: FloatArray = np.sqrt(np.sum(left * left, axis=1) / (neighbours.shape[1] - COEFFICIENTS))
    return residuals
