"""Other poses that may explain the scan as well as a fit: near-symmetries of the part, and its mirror image."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.registration.evidence import NEAR
from dqreg.registration.fit import Fit
from dqreg.search import symmetry_words
from dqreg.search.near_symmetry import flipped_poses, gain_of_mirror
from dqreg.search.poses import Poses
from dqreg.search.scoring import PoseScores, score_poses
from dqreg.search.stages import FINE_APART
from dqreg.trust.records import Alternative

# A pose is better by so much mean log-likelihood at least, and by so many of its standard errors.
BETTER, SIGNIFICANT = 0.02, 5.0
# Points that compare poses.
JUDGES = 10_000
# The same where the time is up, and poses of the loop that are compared then.
FEW_JUDGES, SEEN = 1_000, 6
NO_POSES: FloatArray = np.zeros((0, 4, 4))


def limit_of(fit: Fit) -> float:
    """Distance beyond which a point is an outlier to a comparison of poses, whatever ``max_distance`` was given."""
    return NEAR * fit.problem.reach(fit.prepared)


def scores_of(fit: Fit, poses: FloatArray, count: int = JUDGES) -> PoseScores:
    """How some poses, (k, 4, 4), explain so many points of the scan of a fit."""
    scan, surface = fit.prepared.scan, fit.prepared.surface
    points = scan.points[sample_rows(len(scan), count)]
    return score_poses(Poses.of(poses), points, surface, limit_of(fit), fit.floor)


def best_seen(fit: Fit, start: FloatArray) -> Fit:
    """Where the time ran out: the fit at that of its poses which explains the scan best, the initial one among them."""
    history = fit.run.history
    if fit.run.status != "time limit" or not history:
        return fit
    seen = [start, *(history[k].T_target_source for k in sample_rows(len(history), SEEN))]
    poses = np.stack([fit.T_target_source, *(fit.constraints.project(T) for T in seen)])
    best = int(scores_of(fit, poses, FEW_JUDGES).means.argmax())
    return fit.at(poses[best]) if best else fit


def near_symmetric_poses(fit: Fit) -> FloatArray:
    """The pose after rotations that leave most of the part in place, where they explain the scan about as well."""
    if not fit.found or fit.problem.watch.is_over:
        return NO_POSES
    maps, scan, surface = fit.problem.target.near_rotations, fit.prepared.scan, fit.prepared.surface
    found = flipped_poses(fit.T_target_source, maps, scan, surface, limit_of(fit), fit.floor)
    return np.array([T for T, _ in found]).reshape(-1, 4, 4)


def best_near_symmetric(fit: Fit, kernel_scale: float) -> tuple[Fit, FloatArray]:
    """The fit, or that to a near-symmetric pose which explains the scan significantly better; and equally likely ones.

    Shapes: returns (k, 4, 4).
    """
    others = near_symmetric_poses(fit)
    if not len(others) or fit.problem.options.method != "auto" or fit.constraints.any:
        return fit, others
    scores = scores_of(fit, np.concatenate([fit.T_target_source[None], others]))
    best = int(scores.means.argmax())
    gain, error = float(scores.means[best] - scores.means[0]), float(scores.deficit(best)[1][0])
    if best == 0 or not (gain > max(BETTER, SIGNIFICANT * error) or scores.distinguishable(best)[0]):
        return fit, others
    other = fit.resumed(others[best - 1], kernel_scale)
    return (other, near_symmetric_poses(other)) if other.found else (fit, others)


def mirror_gain(fit: Fit, *, always: bool = False) -> float:
    """Mean log-likelihood that the scan gains when it is mirrored.

    Asked only where some of it lies off a part, or always of a pose that a search has put where it fits.
    """
    target = fit.problem.target
    if (
        target.kind == "cloud"
        or not fit.found
        or fit.problem.watch.is_over
        or not (always or fit.agreement.patches_off > 0.0)
    ):
        return -np.inf
    reflections = target.near_reflections
    return gain_of_mirror(fit.T_target_source, reflections, fit.prepared.scan, target.surface, limit_of(fit), fit.floor)


def alternatives_of(fit: Fit, others: FloatArray) -> tuple[Alternative, ...]:
    """Other poses, (k, 4, 4), as the result names them: each once."""
    if not len(others) or not fit.found:
        return ()
    poses = np.concatenate([fit.T_target_source[None], others])
    middle, (angle_rad, offset) = fit.prepared.scan.points.mean(axis=0), FINE_APART
    diagonal = min(fit.prepared.surface.diagonal, fit.prepared.scan.diagonal)
    poses = poses[Poses.of(poses).distinct(middle, angle_rad, offset * diagonal, len(poses))]
    scores, target = scores_of(fit, poses), fit.problem.target
    deficit, error = scores.deficit(0)
    rms = np.sqrt((scores.distances**2).mean(axis=1))
    found = []
    for k in range(1, len(poses)):
        # Known where a global search has run.
        symmetry = target.pairs.symmetry if "pairs" in vars(target) else None
        axis = symmetry.between(poses[0], poses[k]) if symmetry else None
        words = symmetry_words(axis.moved(target.origin)) if axis else ""
        found.append(
            Alternative(fit.problem.to_caller(poses[k]), float(rms[k]), words, float(-deficit[k]), float(error[k]))
        )
    return tuple(found)
