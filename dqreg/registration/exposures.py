"""Two exposures: part of the scan lies on the target at another pose near by, because something moved between them."""

from __future__ import annotations

import numpy as np

from dqreg.geometry import MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.registration.fit import Fit
from dqreg.rigid import pose
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import refine
from dqreg.trust.patch_tests import INLIER_SIGMAS

# Points that are looked at; those off the target, nearer than this share of its size, are so many and such a share of
# all at least.
LOOKED_AT, NEAR, FEWEST, SHARE = 4_000, 0.1, 150, 0.1
# First and last kernel scale of the refinement of those, in sizes, and their number.
WIDE, NARROW, STEPS = 0.03, 1e-3, 12
# Distances in sizes within which they are on the target, and the share of them that a second pose puts there: of a
# table or a clamp, and of outliers, no pose near by does.
ON_TARGET, FITS = 2e-3, 0.8


def second_pose(fit: Fit) -> tuple[float, float]:
    """Displacement and rotation of the pose at which the points beside the target lie on it; zeros if there is none."""
    surface, scan = fit.prepared.surface, fit.prepared.scan
    if not fit.found or fit.is_late or not isinstance(surface, MeshSurface):
        return 0.0, 0.0
    size, within = surface.diagonal, INLIER_SIGMAS * fit.run.mixture.scale
    if within <= ON_TARGET * size and fit.agreement.share_on >= 1.0 - SHARE and not fit.has_border:
        return 0.0, 0.0
    within = min(within, ON_TARGET * size)
    points = scan.points[sample_rows(len(scan), LOOKED_AT)]
    distances = surface.closest(pose.apply(fit.T_target_source, points)).distances
    beside = points[(distances > within) & (distances <= NEAR * size)]
    if len(beside) < max(FEWEST, SHARE * len(points)):
        return 0.0, 0.0
    sample = OrientedPoints.on_faces(beside[sample_rows(len(beside), 1_000)])
    widths = np.geomspace(WIDE, NARROW, STEPS) * size
    moved = refine(Poses.of(fit.T_target_source[None]), sample, surface, widths).matrices[0]
    placed = pose.apply(moved, beside)
    if np.mean(surface.closest(placed).distances <= within) < FITS:
        return 0.0, 0.0
    shift = float(np.sqrt(((placed - pose.apply(fit.T_target_source, beside)) ** 2).sum(axis=1).mean()))
    return shift, float(pose.angle_between(moved, fit.T_target_source))
