"""Other poses that may explain the scan as well as a fit: near-symmetries of the part, and its mirror image."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.registration.evidence.evidence import near_limit
from dqreg.registration.evidence.other_objects import on_others
from dqreg.registration.fit.displacement import is_elsewhere
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.near_places import is_same_place, near_maps, rows_beside
from dqreg.registration.overlap.free_space import both_rays, met_at, met_by
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose
from dqreg.search.flipped_poses import far_mirrors, flipped_poses, gain_of_mirror
from dqreg.search.near_symmetry import mirrors_about
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.scoring import PoseScores, distances_at, scored
from dqreg.search.search import RAY_CONFLICT_MARGIN
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust.patch_tests import INLIER_SIGMAS

# A pose is better by so much mean log-likelihood at least, and by so many of its standard errors.
MIN_LOG_GAIN, MIN_GAIN_SIGMAS = 0.02, 5.0
# Points that compare poses; and width of their distances, in sizes, that decides between symmetries of a mesh: what a
# sparse scan of curved faces shows as noise is curvature, of which distances from a mesh know nothing.
JUDGING_POINTS, MIN_WIDTH_DIAGONALS = 10_000, 1e-4
# A kernel that wide, in the scan's own noise, may be held so by what stands near by.
WIDE_SCALE_NOISE_RATIO = 1.5
# Points and steps that narrow such a kernel.
NARROWING_POINTS, NARROWING_STEPS = 2_000, 10
# Better near-symmetric poses that follow one another.
MAX_STEPS = 12
# The same where the time is up, and poses of the loop that are compared then.
JUDGING_POINTS_LATE, SEEN_POSES = 500, 4
# Points apart from the target by so many standard deviations of most, each of that share of the size at least.
APART_SIGMAS, MIN_SIGMA_DIAGONALS = 5.0, 1e-4
# The share of points apart from which on the mirror image is asked for.
APART_SHARE = 0.005
# Width that more than half of Gaussian distances exceed.
BELOW_MEDIAN_SIGMAS = 0.6
# Share of a scan off the part from which on any mirror image may hide.
MIRROR_OFF_PART_SHARE = 0.05
# Points, steps and first kernel scale that lead from a pose to the one that it would have without its constraints.
FREEING_POINTS, FREEING_STEPS = 2_000, 15
FREEING_DIAGONALS = 0.05

APART_FROM_TARGET: Key[bool] = Key()
GAIN_IN_MIRROR: Key[float] = Key()
FREED: Key[tuple[float, float, float]] = Key()
NO_POSES: FloatArray = np.zeros((0, 4, 4))


def limit_of(fit: Fit) -> float:
    """Distance beyond which a point is an outlier to a comparison of poses, whatever ``max_distance`` was given."""
    return near_limit(fit.problem.reach(fit.prepared))


def scores_of(fit: Fit, poses: FloatArray, count: int = JUDGING_POINTS) -> PoseScores:
    """How some poses, (k, 4, 4), explain those of so many points of the scan that one of them puts on the target.

    What lies on it under none is another object, the same to all; among much of it no difference would be left.
    """
    return scores_and_rows(fit, poses, count)[0]


def scores_and_rows(fit: Fit, poses: FloatArray, count: int = JUDGING_POINTS) -> tuple[PoseScores, IntArray]:
    """The same, and which points of the scan they are of."""
    rows = rows_beside(fit, poses, limit_of(fit))
    rows = _but_on_others(fit, poses, rows[sample_rows(len(rows), count)])
    scores, on = of_those_on(fit, _distances(fit, poses, rows))
    return scores, rows[on]


def _but_on_others(fit: Fit, poses: FloatArray, rows: IntArray) -> IntArray:
    """Rows of points that tell poses, (k, 4, 4), apart, without those of a scene that are on other objects at all."""
    if not fit.is_scene:
        return rows
    own = rows[~on_others(fit.prepared, fit.problem.derived, poses, fit.prepared.scan.points[rows])]
    return own if len(own) else rows


def _distances(fit: Fit, poses: FloatArray, rows: IntArray) -> FloatArray:
    """How far each of some poses, (k, 4, 4), puts points of the scan from the target, (k, n)."""
    points = np.take(fit.prepared.scan.points, rows, axis=0)
    return distances_at(Poses.of(poses), points, fit.prepared.surface, limit_of(fit))


def of_those_on(fit: Fit, distances: FloatArray, narrowest: float = np.inf) -> tuple[PoseScores, BoolArray]:
    """Scores of poses with such distances, (k, n), by the points that one of them puts on the target; and which, (n,).

    By all where none does. The width of the distances may be as narrow as the scan's noise asks for, or as given.
    """
    scores = scored(distances, limit_of(fit), min(fit.floor, narrowest))
    on = scores.distances.min(axis=0) <= INLIER_SIGMAS * scores.width
    if not on.any():
        return scores, np.ones(len(on), dtype=bool)
    return PoseScores(scores.likelihoods[:, on], scores.distances[:, on], scores.width), on


def best_seen(fit: Fit, start: FloatArray) -> Fit:
    """Where the time ran out: the fit at that of its poses which explains the scan best, the initial one among them."""
    history = fit.run.history
    if fit.run.status != "time limit" or not history:
        return fit
    seen = [start, *(history[k].T_target_source for k in sample_rows(len(history), SEEN_POSES))]
    others = [T for T in map(fit.constraints.project, seen) if not np.array_equal(T, fit.T_target_source)]
    poses = np.stack([fit.T_target_source, *others])
    best = int(scores_of(fit, poses, JUDGING_POINTS_LATE).means.argmax())
    return fit.at(poses[best]) if best else fit


def down_to_noise(fit: Fit) -> Fit:
    """The fit, or that to the pose to which a kernel as narrow as the noise leads, where it explains the scan better.

    The loop learns the width of its kernel from the points near by: those of a table or of other parts hold it wide,
    and draw the pose.
    """
    scan, surface = fit.prepared.scan, fit.prepared.surface
    wide = fit.run.mixture.scale > WIDE_SCALE_NOISE_RATIO * noise_on(scan, surface) > 0.0
    if not fit.found or not wide or fit.between_clouds or fit.problem.watch.is_over or not fit.may_be_moved:
        return fit
    near = fit.run.pairs.distances <= INLIER_SIGMAS * fit.run.mixture.scale
    points = fit.run.pairs.scan.points[near]
    if not near.any():
        return fit
    last = max(noise_on(scan, surface), fit.floor)
    how = Refinement(fit.run.mixture.scale, NARROWING_STEPS, NARROWING_POINTS, last)
    refined = refined_on(fit.T_target_source[None], points, surface, how, unit=1.0)
    scores = scores_of(fit, np.concatenate([fit.T_target_source[None], refined]))
    gain, error = float(scores.means[1] - scores.means[0]), float(scores.deficit(1)[1][0])
    return fit.at(refined[0]) if gain > max(MIN_LOG_GAIN, MIN_GAIN_SIGMAS * error) else fit


def but_symmetric(fit: Fit, others: FloatArray) -> FloatArray:
    """Poses, (k, 4, 4), without those that leave all of the target about where the fit's does."""
    if not len(others):
        return others
    back = pose.inverse(fit.T_target_source)
    return others[[not is_same_place(fit, T @ back) for T in others]]


def _as_likely(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Poses after near symmetries that are as likely as a fit's, (k, 4, 4); distances at it and at them, (k+1, n)."""
    none = NO_POSES, np.zeros((1, 0))
    if not fit.found or fit.problem.watch.is_over:
        return none
    scan, surface = fit.prepared.scan, fit.prepared.surface
    maps = near_maps(fit)
    if not len(maps):
        return none
    asked, in_scene = None, fit.is_scene
    rows = rows_beside(fit, np.concatenate([fit.T_target_source[None], maps @ fit.T_target_source]), limit_of(fit))
    if in_scene:
        scan = scan.taken(_but_on_others(fit, fit.T_target_source[None], rows))
    elif isinstance(surface, MeshSurface):
        pairs = fit.evenly_asked()
        asked = pairs.scan.points, pairs.distances
    # Of few points amid a scene none is refined that far.
    scale = np.inf if in_scene else fit.run.mixture.scale
    found = flipped_poses(fit.T_target_source, maps, scan, surface, limit_of(fit), fit.floor, asked, scale)
    others = np.array([T for T, _ in found]).reshape(-1, 4, 4)
    if not len(others):
        return none
    poses = np.concatenate([fit.T_target_source[None], others])
    rows = _but_on_others(fit, poses, rows[sample_rows(len(rows), JUDGING_POINTS)])
    distances = _distances(fit, poses, rows)
    # Few points may tell them apart where their mean does not.
    scores, _ = of_those_on(fit, distances)
    likely = np.flatnonzero(scores.as_likely(0, MIN_LOG_GAIN) & ~scores.distinguishable(0))
    likely = np.union1d(0, likely[_may_stay(fit, poses[likely])])
    return poses[likely][1:], distances[likely]


def _may_stay(fit: Fit, poses: FloatArray) -> BoolArray:
    """Which poses, (k, 4, 4), are none at which rays passed through more of the other scan than at the fit's, (k,)."""
    if len(poses) < 2 or (rays := both_rays(fit.problem)) is None or (here := met_at(fit)) is None:
        return np.ones(len(poses), dtype=bool)
    return np.asarray(met_by(fit, rays, poses).through <= here.through[0] + RAY_CONFLICT_MARGIN)


def best_near_symmetric(
    fit: Fit, kernel_scale: float | None, start: FloatArray | None = None
) -> tuple[Fit, FloatArray]:
    """The fit, or that to a near-symmetric pose which explains the scan significantly better; and equally likely ones.

    Between clouds a better one has more in common, which does not speak against an initial pose: what that did not mean
    is named alone. Shapes: returns (k, 4, 4).
    """
    others, distances = _as_likely(fit)
    narrowest = np.inf if fit.between_clouds else MIN_WIDTH_DIAGONALS * fit.prepared.surface.diagonal
    if not fit.may_be_moved:
        return fit, but_symmetric(fit, others)
    # Several periods away the next one is better each time.
    for _ in range(MAX_STEPS):
        if not len(others):
            break
        scores, _ = of_those_on(fit, distances, narrowest)
        best = int(np.where(_are_allowed(fit, others, start), scores.means, -np.inf).argmax())
        gain, error = float(scores.means[best] - scores.means[0]), float(scores.deficit(best)[1][0])
        if best == 0 or not (gain > max(MIN_LOG_GAIN, MIN_GAIN_SIGMAS * error) or scores.distinguishable(best)[0]):
            break
        other = fit.resumed(others[best - 1], kernel_scale)
        if not other.found:
            break
        fit, (others, distances) = other, _as_likely(other)
    return fit, but_symmetric(fit, others)


def _are_allowed(fit: Fit, others: FloatArray, start: FloatArray | None) -> BoolArray:
    """Whether a fit, and which of other poses, (k, 4, 4), may be the answer by what they have in common, (k+1,)."""
    allowed = np.ones(len(others) + 1, dtype=bool)
    if fit.between_clouds and not is_elsewhere(fit, fit.T_target_source, start):
        allowed[1:] = [not is_elsewhere(fit, T, start) for T in others]
    return allowed


def mirror_gain(fit: Fit, *, always: bool = False) -> float:
    """Mean log-likelihood that the scan gains when it is mirrored.

    Asked only where some of it lies off a part, or always of a pose that a search has put where it fits; where much
    lies off it, of mirrors too that leave little of the part in place.
    """
    target = fit.problem.target
    if (
        fit.between_clouds
        or not fit.found
        or fit.problem.watch.is_over
        or not (
            always
            or fit.agreement.patches_off > 0.0
            or _much_is_off(fit)
            or fit.derived.once(APART_FROM_TARGET, lambda: _some_apart(fit))
        )
    ):
        return -np.inf

    def gain() -> float:
        mirrors, asked = target.near_reflections, (fit.prepared.scan, target.surface, limit_of(fit), fit.floor)
        if _much_is_off(fit) and isinstance(target.geometry, Mesh):
            far = far_mirrors(fit.T_target_source, mirrors_about(target.geometry), *asked)
            mirrors = np.concatenate([mirrors, far])
        return gain_of_mirror(fit.T_target_source, mirrors, *asked)

    return fit.derived.once(GAIN_IN_MIRROR, gain)


def gain_if_freed(fit: Fit) -> tuple[float, float, float]:
    """Mean log-likelihood that the scan gains without locked motions and prior; rotation and shift to that pose.

    The gain is 0 where it is not significant, and NaN where there is no time to ask.
    """
    if not fit.found or fit.problem.watch.is_over:
        return np.nan, np.nan, np.nan

    def freed() -> tuple[float, float, float]:
        here, surface = fit.T_target_source, fit.prepared.surface
        points = fit.prepared.scan.thinned(FREEING_POINTS).points
        how = Refinement(FREEING_DIAGONALS * surface.diagonal, FREEING_STEPS, FREEING_POINTS, fit.floor)
        there = refined_on(here[None], points, surface, how, unit=1.0)[0]
        scores = scores_of(fit, np.stack([here, there]))
        gain, error = float(scores.means[1] - scores.means[0]), float(scores.deficit(1)[1][0])
        shift = float(np.linalg.norm((there @ pose.inverse(here))[:3, 3]))
        return gain if gain > MIN_GAIN_SIGMAS * error else 0.0, float(pose.angle_between(here, there)), shift

    return fit.derived.once(FREED, freed)


def _much_is_off(fit: Fit) -> bool:
    """Whether more of a scan that is no scene lies off the part than a near mirror image leaves."""
    return fit.agreement.share_on < 1.0 - MIRROR_OFF_PART_SHARE and not fit.is_scene


def _some_apart(fit: Fit) -> bool:
    """Whether some points near the target are far from it, measured by most: what a sparse scan shows of a mirror."""
    pairs, surface = fit.run.pairs, fit.prepared.surface
    if pairs.scan.counts is not None or len(pairs.scan) > JUDGING_POINTS:
        # Rows that stand for many points scatter less than those of one: beside them each of these would seem far.
        pairs = fit.evenly_asked()
    size = surface.diagonal
    near = pairs.distances <= limit_of(fit)
    aside = np.abs(pairs.point_to_plane[near])
    # Where more than half are beyond a length, so is the median: of noise about the width, that settles it.
    least = BELOW_MEDIAN_SIGMAS * fit.run.mixture.scale
    most_above = 2 * np.count_nonzero(aside > least) > len(aside)
    if most_above and not _too_many(aside, APART_SIGMAS * GAUSSIAN_MEDIAN * least):
        return False
    usual = max(GAUSSIAN_MEDIAN * median(aside), MIN_SIGMA_DIAGONALS * size) if len(aside) else np.inf
    return _too_many(aside, APART_SIGMAS * usual)


def _too_many(aside: FloatArray, limit: float) -> bool:
    return bool(np.count_nonzero(aside > limit) > APART_SHARE * len(aside))
