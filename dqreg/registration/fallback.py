"""What else may explain the scan: a pose from a global search where the fit is in doubt, near-symmetries, a mirror."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.registration.evidence import NEAR
from dqreg.registration.fit import Fit
from dqreg.registration.initial_pose import GlobalSearch
from dqreg.rigid import pose
from dqreg.search.near_symmetry import flipped_poses, gain_of_mirror
from dqreg.search.poses import Poses
from dqreg.search.scoring import score_poses
from dqreg.trust.records import Alternative

# Patches of points off the target, or points with another normal, beyond which the pose is doubted enough to search for
# another one.
DOUBT, DOUBT_BORDER = 0.1, 0.3
# And standard deviations of the distances, in the scan's own noise.
MISFIT = 10.0
# A pose that explains the scan better by so much mean log-likelihood is taken, if it is within this rotation and this
# fraction of the target's size of the initial pose that was given: that one is rough, but it is meant.
BETTER = 0.02
MEANT_RAD, MEANT = np.deg2rad(40.0), 0.25
JUDGES = 10_000


def may_search(fit: Fit) -> bool:
    """Whether a global search beside the initial pose is allowed; what was asked for in so many words is done alone."""
    options = fit.problem.options
    return options.search == "always" or (
        options.search == "doubt" and options.method == "auto" and not fit.constraints.any
    )


def is_doubtful(fit: Fit) -> bool:
    """Whether so much speaks against a pose that another one is worth searching for."""
    found = fit.agreement
    # Two scans of one scene always differ somewhere, and their normals are estimates.
    doubt = DOUBT_BORDER if fit.has_border else DOUBT
    return (
        found.patches_off > doubt + found.strays
        or found.normals_apart > doubt
        or found.width > MISFIT * found.expected > 0.0
    )


def retry_from_search(fit: Fit, start: FloatArray, search: GlobalSearch) -> tuple[Fit, tuple[Alternative, ...]]:
    """The better of a doubtful fit and of what a global search finds, which is reported where it is far from the start.

    Shapes: start (4, 4).
    """
    if not may_search(fit) or fit.problem.watch.is_over:
        return fit, ()
    if fit.problem.options.search != "always" and not is_doubtful(fit):
        return fit, ()
    found = search.candidates()
    if not found:
        return fit, ()
    other = fit.resumed(found[0].T_target_source, search.kernel_scale)
    if not other.found:
        return fit, ()
    gain, rms = _gain(fit, other)
    if gain <= BETTER:
        return fit, ()
    T = other.T_target_source
    rotation, shift = pose.angle_between(T, start), pose.offset_between(T, start, at=np.zeros(3))
    if rotation <= MEANT_RAD and shift <= MEANT * fit.prepared.surface.diagonal:
        return other, ()
    return fit, (Alternative(fit.problem.to_caller(T), rms),)


def near_symmetric_poses(fit: Fit) -> tuple[Alternative, ...]:
    """The pose after rotations that leave most of the part in place, where they explain the scan about as well."""
    limit, rotations = NEAR * fit.settings.max_distance, fit.problem.target.near_rotations
    found = flipped_poses(fit.T_target_source, rotations, fit.prepared.scan, fit.prepared.surface, limit, fit.floor)
    return tuple(Alternative(fit.problem.to_caller(T), rms) for T, rms in found)


def mirror_gain(fit: Fit) -> float:
    """Mean log-likelihood that the scan gains when it is mirrored; asked only where some of it lies off a part."""
    target = fit.problem.target
    if target.kind == "cloud" or not fit.found or not fit.agreement.patches_off > 0.0:
        return -np.inf
    limit, reflections = NEAR * fit.settings.max_distance, target.near_reflections
    return gain_of_mirror(fit.T_target_source, reflections, fit.prepared.scan, target.surface, limit, fit.floor)


def _gain(fit: Fit, other: Fit) -> tuple[float, float]:
    # Mean log-likelihood that the other pose gains, and its truncated distance.
    poses = Poses.of(np.stack([fit.T_target_source, other.T_target_source]))
    scan, surface = fit.prepared.scan, fit.prepared.surface
    points = scan.points[sample_rows(len(scan), JUDGES)]
    scores = score_poses(poses, points, surface, NEAR * fit.settings.max_distance, fit.floor)
    return float(scores.means[1] - scores.means[0]), float(np.sqrt((scores.distances[1] ** 2).mean()))
