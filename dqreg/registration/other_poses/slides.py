"""Motions that few points constrain, or none: what the whole scan loses where the pose is displaced along them.

Few points on an end face fix a long bar along its axis, and points that would hang in the air beyond its rim do so as
well, even where no point lies on an end: the number of points along whose normal the motion goes says little. So the
pose is displaced, refined, and all points are asked again.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.icp import find_correspondences
from dqreg.registration.evidence.surroundings import surroundings_of
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import JUDGING_POINTS, scores_and_rows, scores_of
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.scoring import CLEAR_LOG_RATIO
from dqreg.search.symmetry import ON_PART_DIAGONALS
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD, fewest_carriers
from dqreg.trust.patch_tests import INLIER_SIGMAS, is_background

# Displacements that are tried either way, in sizes; those from the second on count as they are, all of them where a
# refinement leads from there.
DISPLACEMENTS_DIAGONALS = (0.01, 0.02, 0.05, 0.1)
# A refinement that ends this near, in sizes, has led back.
RETURNED_DIAGONALS = 0.005
# Refinement of what is displaced.
REFINEMENT = Refinement(first=6e-3, steps=6)
# Points that hold a motion at least, and the log-likelihood that one may lose at most: few strays hold nothing.
FEWEST_HELD = 8
MAX_POINT_LOG_LIKELIHOOD = CONSTRAINT_LOG_LIKELIHOOD / FEWEST_HELD
# Standard deviations of a count that chance reaches.
CHANCE_SIGMAS = 3.0
# Log-likelihood of all points from which another pose is better; times that one is gone on from.
BETTER_LOG_LIKELIHOOD, MAX_ROUNDS = 5.0, 2
# Where points that gain clearly have more than this share of what others lose, the scan is divided.
SPLIT_SHARE = 1.0 / 3.0
# Points that tell which displacements lose so much that all of them need not be asked, by so many times what a motion
# has to: chance takes none of it back.
SCREENING_POINTS, CERTAIN_LOSS_FACTOR = 1_000, 10.0
# The least so many of a kind are asked of all points in any case.
MIN_JUDGED_OF_KIND = 2
# Neighbours whose plane tells whether a point off the target is of a table.
PLANE_NEIGHBOURS = 8
# So many motions at once are those of a single plane: a plate seen from one side. Those of as many at most are mixed.
MOTIONS_OF_PLANE = 3


@dataclasses.dataclass(frozen=True)
class Slide:
    """What the scan says of the poses along its weakly constrained motions."""

    loss: float = np.nan  # Least log-likelihood that all points together lose there; NaN where it was not asked
    best: FloatArray | None = None  # (4, 4): A refined pose that explains the scan better
    # Standard deviation along motions that no normal constrains, as the rims of the target hold them; NaN: they do not
    by_rims: float = np.nan


SLIDE: Key[Slide] = Key(of_pose=True)


def slide_of(fit: Fit) -> Slide:
    """Displace a pose on a part along all motions that few points constrain, or none."""
    return fit.derived.once(SLIDE, lambda: _slide_of(fit))


def _slide_of(fit: Fit, share: float = 0.0) -> Slide:
    if not fit.found or fit.between_clouds or fit.problem.watch.is_over:
        return Slide()
    motions, free = _motions(fit, share)
    if not len(motions):
        return Slide()
    size = fit.prepared.surface.diagonal
    steps = [sign * step * size for step in DISPLACEMENTS_DIAGONALS for sign in (1.0, -1.0)]
    moved = np.stack([twist.exp(step * motion) @ fit.T_target_source for step in steps for motion in motions])
    sample = REFINEMENT.sample(fit.prepared.scan.points)
    refined = refined_on(moved, sample.points, fit.prepared.surface, REFINEMENT)
    along_free = moved.reshape(len(steps), -1, 4, 4)[:, len(motions) - free :]
    poses = np.concatenate([fit.T_target_source[None], moved, refined])
    ends = sample.points[[*sample.points.argmin(axis=0), *sample.points.argmax(axis=0)]]
    here = pose.apply(poses[0], ends)
    moved = np.array([np.linalg.norm(pose.apply(T, ends) - here, axis=1).max() for T in poses[1:]])
    counted = moved > RETURNED_DIAGONALS * size
    counted[: 2 * len(motions)] = False
    losses = _losses_that_matter(fit, poses, counted, 2 * len(motions))
    best = 2 * len(motions) + int(losses[2 * len(motions) :].argmin())
    loss = float(losses[counted].min(initial=np.inf))
    better = poses[1 + best] if losses[best] < -BETTER_LOG_LIKELIHOOD else None
    reach = np.nan
    if free and loss >= CONSTRAINT_LOG_LIKELIHOOD and not _stays_on_part(fit, along_free):
        nearest = losses[: 2 * len(motions)].min() >= CONSTRAINT_LOG_LIKELIHOOD
        # Anywhere within the least displacement that is excluded: an even distribution.
        reach = DISPLACEMENTS_DIAGONALS[0 if nearest else 1] * size / np.sqrt(3.0)
    return Slide(loss, better, reach)


def _stays_on_part(fit: Fit, poses: FloatArray) -> bool:
    """Whether one of k motions, displaced m times, (m, k, 4, 4), takes no more points off the part than it puts on.

    But for its facets: to a scan without noise, those of a round part are rims. A notch holds a rotation at its place
    alone; elsewhere it is off some points before, and off as many after.
    """
    pairs, surface = fit.run.pairs, fit.prepared.surface
    rows = np.flatnonzero(pairs.distances <= fit.agreement.near)
    rows = rows[sample_rows(len(rows), JUDGING_POINTS)]
    points, before, margin = pairs.scan.points[rows], pairs.distances[rows], ON_PART_DIAGONALS * surface.diagonal

    def is_held(T: FloatArray) -> bool:
        gaps = surface.closest(pose.apply(T, points)).distances - before
        lost, put_on = np.count_nonzero(gaps > margin), np.count_nonzero(gaps < -margin)
        return bool(lost - put_on >= FEWEST_HELD + CHANCE_SIGMAS * math.sqrt(put_on))

    return any(not any(map(is_held, along)) for along in poses.swapaxes(0, 1))


def _motions(fit: Fit, share: float) -> tuple[FloatArray, int]:
    """Twists, (k, 6), of displacement one along which the pose is displaced; and how many at the end are free."""
    information = fit.information
    free, nothing = information.free, np.zeros((0, 6))
    inliers = float(fit.run.weights.sum())
    weak = ~free & (information.carriers < max(fewest_carriers(inliers), share * inliers))
    # An open target ends where it was not measured, and its rim holds nothing.
    held_by_rims = bool(0 < np.count_nonzero(free) <= MOTIONS_OF_PLANE and not fit.has_border)
    # One riser on its neighbour's place, and all others off, look like a strain across them.
    along = fit.strain_axis if share else ()
    strained = np.array([[0.0, 0.0, 0.0, *along]] if any(along) else nothing)
    if fit.constraints.any or not (weak.any() or held_by_rims or len(strained)):
        return nothing, 0
    unit = information.vectors / scaling_by(information.lever)[:, None]
    motions = [_mixtures(unit[:, weak]), strained]
    motions.append(_mixtures(unit[:, free]) if held_by_rims else nothing)
    return np.concatenate(motions).astype(np.float64), len(motions[-1])


def _mixtures(motions: FloatArray) -> FloatArray:
    """Motions, (6, k), and mixtures of them where they are few, (m, 6), one of each pair of opposites."""
    count = motions.shape[1]
    if not 0 < count <= MOTIONS_OF_PLANE:
        return motions.T
    signs = np.array(list(itertools.product([1.0, 0.0, -1.0], repeat=count)))
    signs = signs[: len(signs) // 2]
    return np.asarray(signs / np.linalg.norm(signs, axis=1, keepdims=True) @ motions.T)


def without_slide(fit: Fit, share: float = 0.0) -> tuple[Fit, Slide]:
    """The fit, or that to a pose along a weakly constrained motion that explains the scan better.

    Motions that less than a share of the inliers constrain are tried as well: a wall that lies on its other side does.
    So is the axis of a strain, which has to vanish there: a part that moved during the scan fits in part anywhere.
    """
    slide = slide_of(fit) if not share else _slide_of(fit, share)
    for _ in range(MAX_ROUNDS):
        if slide.best is None or not fit.may_be_moved:
            break
        # The loop may lead back to where it was: then the pose of the refinement stays.
        there = fit.at(slide.best)
        other = fit.resumed(slide.best, REFINEMENT.last * fit.prepared.surface.diagonal)
        better = other if other.found and _gain(there, other) >= 0.0 else there
        if share and fit.agreement.stretch and better.agreement.stretch:
            break
        fit = better
        slide = slide_of(fit) if not share else _slide_of(fit, share)
    return fit, slide


def _losses_that_matter(fit: Fit, poses: FloatArray, counted: BoolArray, nearest: int) -> FloatArray:
    """What all points lose at each of some poses but the first, (k,); infinity where few lose so much that it is clear.

    The least losses of the nearest displacements, of the others and of those that count are always asked of all points.
    """
    if len(fit.prepared.scan) <= 2 * SCREENING_POINTS:
        return losses_at(fit, poses)
    scores = scores_of(fit, poses, SCREENING_POINTS)
    few = _losses(scores.likelihoods[0] - scores.likelihoods[1:], split=0.5 * SPLIT_SHARE)
    asked, rows = few < CERTAIN_LOSS_FACTOR * CONSTRAINT_LOG_LIKELIHOOD, np.arange(len(few))
    for group in (rows[:nearest], rows[nearest:], rows[counted]):
        asked[group[np.argsort(few[group], kind="stable")[:MIN_JUDGED_OF_KIND]]] = True
    losses = np.full(len(few), np.inf)
    losses[asked] = losses_at(fit, np.concatenate([poses[:1], poses[1:][asked]]))
    return losses


def losses_at(fit: Fit, poses: FloatArray, count: int = JUDGING_POINTS) -> FloatArray:
    """Log-likelihood that so many points together lose at each of some poses, (k, 4, 4), against the first of them."""
    return losses_and_scatter(fit, poses, count)[0]


def losses_and_scatter(fit: Fit, poses: FloatArray, count: int = JUDGING_POINTS) -> tuple[FloatArray, FloatArray]:
    """The same, and their standard deviations by chance, (k,): as what speaks for the other pose scatters."""
    scores, rows = scores_and_rows(fit, poses, count)
    gaps = scores.likelihoods[0] - scores.likelihoods[1:]
    scatter = np.sqrt(2.0 * (np.clip(gaps, -MAX_POINT_LOG_LIKELIHOOD, 0.0) ** 2).sum(axis=1))
    return _losses(gaps, lambda: _of_the_part(fit, rows)), scatter


def _of_the_part(fit: Fit, rows: IntArray) -> BoolArray:
    """Which points of a scan, by their rows, are neither of far objects nor in a plane that goes on there; (m,).

    What goes on far off is asked of all of the scan: the rows are of points that some pose puts on the part.
    """
    if fit.has_border:
        return np.ones(len(rows), dtype=bool)
    whole, near = fit.evenly_asked(), fit.agreement.near
    width = min(INLIER_SIGMAS * fit.run.mixture.scale, near)
    on, far = whole.distances <= width, whole.distances > near
    elsewhere = surroundings_of(whole, width, near, fit.prepared.surface.diagonal).elsewhere
    pairs = find_correspondences(fit.prepared.scan.taken(rows), fit.prepared.surface, fit.T_target_source)
    of_the_part, off = np.ones(len(rows), dtype=bool), np.flatnonzero(pairs.distances > width)
    if len(off) and far.any():
        beside = NeighbourTree(whole.moved).nearest(pairs.moved[off], PLANE_NEIGHBOURS)[0]
        goes_on = is_background(whole.moved[beside], whole.moved, on, far, fit.run.mixture.scale)
        of_the_part[off] = ~(elsewhere[beside[:, 0]] | goes_on)
    return of_the_part


def _losses(
    gaps: FloatArray, of_the_part: Callable[[], BoolArray] | None = None, split: float = SPLIT_SHARE
) -> FloatArray:
    """Sums of the log-likelihoods that points lose, (k, m) to (k,); nothing where many of the part gain clearly.

    A part that slides over its table comes to lie on that: such points gain, and are no part that was left behind.
    """
    gaps = np.clip(gaps, -MAX_POINT_LOG_LIKELIHOOD, MAX_POINT_LOG_LIKELIHOOD)
    losses, clear = gaps.sum(axis=1), np.where(np.abs(gaps) > CLEAR_LOG_RATIO, gaps, 0.0)
    against, gains = np.maximum(clear, 0.0).sum(axis=1), np.maximum(-clear, 0.0)
    # Which points are of the part matters where all that gain are many.
    many = np.flatnonzero((gains.sum(axis=1) > split * against) & (losses > 0.0))
    if len(many) and of_the_part is not None:
        many = many[gains[np.ix_(many, np.flatnonzero(of_the_part()))].sum(axis=1) > split * against[many]]
    losses[many] = 0.0
    return np.asarray(losses)


def _gain(fit: Fit, other: Fit) -> float:
    means = scores_of(fit, np.stack([fit.T_target_source, other.T_target_source])).means
    return float(means[1] - means[0])
