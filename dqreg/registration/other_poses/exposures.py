"""Two exposures: part of the scan lies on the target at another pose near by, because something moved between them."""

from __future__ import annotations

import numpy as np

from dqreg.geometry.normals import sample_rows
from dqreg.registration.fit.fit import Fit
from dqreg.rigid import pose
from dqreg.search.refine import Refinement, refined_on
from dqreg.trust.patch_tests import INLIER_SIGMAS

# Points that are looked at.
COMPARED_POINTS = 4_000
# Those off the target, nearer than this share of its size, are so many and such a share of all at least.
NEAR_TARGET_DIAGONALS = 0.1
MIN_OFF_POINTS, MIN_OFF_SHARE = 150, 0.1
# Refinement on those.
REFINEMENT = Refinement(first=0.03, steps=12)
# Distances in sizes within which they are on the target, and the share of them that a second pose puts there: of a
# table or a clamp, and of outliers, no pose near by does.
ON_TARGET_DIAGONALS, MIN_FITTED_SHARE = 2e-3, 0.8


def second_pose(fit: Fit) -> tuple[float, float]:
    """Displacement and rotation of the pose at which the points beside the target lie on it; zeros if there is none."""
    surface, scan = fit.prepared.surface, fit.prepared.scan
    if not fit.found or fit.is_late or fit.between_clouds:
        return 0.0, 0.0
    size, within = surface.diagonal, INLIER_SIGMAS * fit.run.mixture.scale
    # Faces that are deformed beside their place have not moved.
    share_on = fit.agreement.share_on + fit.agreement.share_deformed
    most = ON_TARGET_DIAGONALS * size * fit.agreement.deviation_ratio
    if within <= most and share_on >= 1.0 - MIN_OFF_SHARE and not fit.has_border:
        return 0.0, 0.0
    # A face that is off by what is expected is not beside the target.
    within = max(min(within, most), fit.agreement.expected_deviation)
    points = scan.points[sample_rows(len(scan), COMPARED_POINTS)]
    distances = surface.closest(pose.apply(fit.T_target_source, points)).distances
    beside = points[(distances > within) & (distances <= NEAR_TARGET_DIAGONALS * size)]
    if len(beside) < max(MIN_OFF_POINTS, MIN_OFF_SHARE * len(points)):
        return 0.0, 0.0
    moved = refined_on(fit.T_target_source[None], beside, surface, REFINEMENT)[0]
    placed = pose.apply(moved, beside)
    if np.mean(surface.closest(placed).distances <= within) < MIN_FITTED_SHARE:
        return 0.0, 0.0
    shift = float(np.sqrt(((placed - pose.apply(fit.T_target_source, beside)) ** 2).sum(axis=1).mean()))
    return shift, float(pose.angle_between(moved, fit.T_target_source))
