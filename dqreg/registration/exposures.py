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

# Points that are looked at.
COMPARED_POINTS = 4_000
# Those off the target, nearer than this share of its size, are so many and such a share of all at least.
NEAR_TARGET_DIAGONALS = 0.1
MIN_OFF_POINTS, MIN_OFF_SHARE = 150, 0.1
# First and last kernel scale of the refinement of those, in sizes, and their number.
FIRST_SCALE_DIAGONALS, LAST_SCALE_DIAGONALS = 0.03, 1e-3
REFINEMENT_STEPS = 12
# Distances in sizes within which they are on the target, and the share of them that a second pose puts there: of a
# table or a clamp, and of outliers, no pose near by does.
ON_TARGET_DIAGONALS, MIN_FITTED_SHARE = 2e-3, 0.8


def second_pose(fit: Fit) -> tuple[float, float]:
    """Displacement and rotation of the pose at which the points beside the target lie on it; zeros if there is none."""
    surface, scan = fit.prepared.surface, fit.prepared.scan
    if not fit.found or fit.is_late or not isinstance(surface, MeshSurface):
        return 0.0, 0.0
    size, within = surface.diagonal, INLIER_SIGMAS * fit.run.mixture.scale
    # Faces that are deformed beside their place have not moved.
    share_on = fit.agreement.share_on + fit.agreement.share_deformed
    if within <= ON_TARGET_DIAGONALS * size and share_on >= 1.0 - MIN_OFF_SHARE and not fit.has_border:
        return 0.0, 0.0
    within = min(within, ON_TARGET_DIAGONALS * size)
    points = scan.points[sample_rows(len(scan), COMPARED_POINTS)]
    distances = surface.closest(pose.apply(fit.T_target_source, points)).distances
    beside = points[(distances > within) & (distances <= NEAR_TARGET_DIAGONALS * size)]
    if len(beside) < max(MIN_OFF_POINTS, MIN_OFF_SHARE * len(points)):
        return 0.0, 0.0
    sample = OrientedPoints.on_faces(beside[sample_rows(len(beside), 1_000)])
    widths = np.geomspace(FIRST_SCALE_DIAGONALS, LAST_SCALE_DIAGONALS, REFINEMENT_STEPS) * size
    moved = refine(Poses.of(fit.T_target_source[None]), sample, surface, widths).matrices[0]
    placed = pose.apply(moved, beside)
    if np.mean(surface.closest(placed).distances <= within) < MIN_FITTED_SHARE:
        return 0.0, 0.0
    shift = float(np.sqrt(((placed - pose.apply(fit.T_target_source, beside)) ** 2).sum(axis=1).mean()))
    return shift, float(pose.angle_between(moved, fit.T_target_source))
