"""Noise of a scan, from what its points leave of planes and quadrics fitted to their neighbours.

What 16 neighbours leave of their plane is noise on a dense scan; on a sparse one it is the curvature of the faces and
the edges between them, up to eighty times the noise. Quadrics follow the curvature, and where they leave least there is
no edge. Neither knows thin sheets, of which the neighbours lie on both sides, nor scans so sparse that edges are
everywhere: there the plane that most of the neighbours lie near is of one face. Where the noise is the same all over,
all three agree.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray, IntArray, median, quantile
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, PlaneFits, sample_rows

# Neighbourhoods in which quadrics are fitted; fewer than the least tell nothing.
QUADRIC_SAMPLE, MIN_QUADRICS = 400, 40
# Those that one thread goes over at a time.
CHUNK_QUADRICS = 100
# Neighbours along one ring of a LiDAR lie in the plane of its laser, round a corner too, which says nothing of the
# noise: their least spread is below this share of the largest. Of 64 scans by cameras 98 % of the neighbourhoods were
# wider at least, of rings down to 58 %; so many have to be.
ROUND_SPREAD_RATIO, MIN_ROUND_SHARE = 0.3, 0.9
# Edges and curvature leave a tenth of the spacing of the points and more; what is far below is noise.
FAR_BELOW = 0.05
# Quantile of what quadrics leave, and what that is of the standard deviation where all of it is Gaussian noise: the
# root of the chi-squared quantile over its 10 degrees of freedom.
QUIET_QUANTILE, QUIET_SIGMAS = 0.25, 0.8208
# Planes through three of the neighbours that are tried; so many of the 16 lie near the best one, those three included.
TRIED_TRIPLES, MAJORITY_POINTS = 40, 7
# Least area of the three, doubled, in mean square extents.
MIN_TRIPLE_AREA = 0.5
# Cosine of a plane's normal with that of all neighbours, below which it stands on their face: the laser's own plane, in
# which all points of a ring round a curved face lie.
STANDING_COS = 0.5
# Lower quantile of how far they lie, and what that is of the standard deviation where all is Gaussian noise about a
# plane: measured on 20,000 points, to 2 %.
FACE_QUANTILE, MAJORITY_SIGMAS = 0.25, 0.168
# Faces that the sensor sees at a slant scatter less across themselves: the quiet ones are quieter than most by this.
SLANTED_NOISE_RATIO = 1.2


def noise_of(
    fits: PlaneFits, points: FloatArray, at: FloatArray, tree: NeighbourTree, spacing: float, *, quiet: bool
) -> tuple[float, float | None]:
    """Standard deviation of points across their faces: what most planes leave, and quadrics on the quieter faces.

    None for these where they are not asked about. Shapes: points (n, 3), in the order of those of the tree, at (m, 3),
    where planes are fitted.
    """
    known = np.flatnonzero(fits.known)
    planes = median(fits.residuals[known]) if len(known) else 0.0
    return planes, _on_quiet_faces(planes, known, fits, points, at, tree, spacing) if quiet else None


def _on_quiet_faces(
    planes: float,
    known: IntArray,
    fits: PlaneFits,
    points: FloatArray,
    at: FloatArray,
    tree: NeighbourTree,
    spacing: float,
) -> float:
    """What quadrics leave on the quieter faces, of some that are known; what planes leave where these tell no more."""
    rows = known[sample_rows(len(known), QUADRIC_SAMPLE)]
    if len(rows) < MIN_QUADRICS or fits.count < NORMAL_NEIGHBOURS or not planes > FAR_BELOW * spacing:
        return planes
    # They were found for the planes, where these are not many.
    around = fits.neighbours[rows] if fits.neighbours is not None else _around(tree, at, rows)
    left = _quadric_residuals(points, around, fits.normals[rows])
    if len(left) < MIN_ROUND_SHARE * len(rows):
        return planes
    quiet = quantile(left, QUIET_QUANTILE) / QUIET_SIGMAS
    if quiet > FAR_BELOW * spacing:
        faces = _off_majorities(points, around, fits.normals[rows])
        quiet = min(quiet, quantile(faces, FACE_QUANTILE) / MAJORITY_SIGMAS) if len(faces) >= MIN_QUADRICS else quiet
    return min(planes, SLANTED_NOISE_RATIO * quiet)


def _around(tree: NeighbourTree, at: FloatArray, rows: IntArray) -> IntArray:
    found = tree.nearest_to(rows, NORMAL_NEIGHBOURS) if tree.is_of(at) else tree.nearest(at[rows], NORMAL_NEIGHBOURS)
    return found[0]


def _quadric_residuals(points: FloatArray, neighbours: IntArray, normals: FloatArray) -> FloatArray:
    """Root mean square of what neighbours, (m, k), leave of a quadric over their plane, of those in no profile."""
    from dqreg.kernels.clouds.quadric_fits import quadric_residual_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    residuals = np.zeros(len(neighbours))
    given = as_plain(points), neighbours, as_plain(normals), ROUND_SPREAD_RATIO
    over_chunks(quadric_residual_rows, len(neighbours), *given, residuals, chunk=CHUNK_QUADRICS)
    return residuals[np.isfinite(residuals)]


def _off_majorities(points: FloatArray, neighbours: IntArray, normals: FloatArray) -> FloatArray:
    """How far most of the neighbours, (m, k), lie from the plane that most lie near, where they span one."""
    from dqreg.kernels.clouds.majority_planes import majority_plane_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    found = np.zeros(len(neighbours))
    triples = _triples(neighbours.shape[1])
    given = as_plain(points), neighbours, as_plain(normals), triples, MAJORITY_POINTS, MIN_TRIPLE_AREA, STANDING_COS
    over_chunks(majority_plane_rows, len(neighbours), *given, found, chunk=CHUNK_QUADRICS)
    return found[np.isfinite(found)]


@lru_cache(maxsize=4)
def _triples(count: int) -> IntArray:
    """Three of so many neighbours, (t, 3), the same ones each time."""
    permuted = np.random.default_rng(0).permuted(np.tile(np.arange(count), (TRIED_TRIPLES, 1)), axis=1)
    return np.ascontiguousarray(permuted[:, :3])
