"""Poses of a scan after near symmetries of a part, or in its mirror: which of them explain it as well.

Few points refine and compare them first, and more of them what these leave.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Scan, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.rigid import pose
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import LAST_SCALE_DIAGONALS, Refinement, refine
from dqreg.search.scoring import PoseScores, distances_at, likely_by, mean_gains, score_poses, scored

# Points that screen a flipped pose, and the mean gain that it may lack by them: few first, which most flips fail.
# Reach of their gain, in sizes.
SCREEN_ROUNDS, SCREEN_REACH_DIAGONALS = ((60, 0.3), (300, 0.15)), 0.02
# Points that refine, points that score and steps of the refinement: few of all poses, and more of those that are not
# clearly worse by them. After four steps scores differ from those after six by a third of their standard error at most.
FIRST_REFINEMENT = (300, 1_000, 4)
LAST_REFINEMENT = (1_000, 5_000, 6)
# Mirrors need more: none is a pose that the loop has led to. On one part of 30 six steps ended where nothing is gained.
MIRROR_REFINEMENT = (1_000, 5_000, 12)
# Standard errors of the mean log-likelihood beyond which a pose is clearly worse. Six motions fitted to so few points
# cost the others three log-likelihoods in the mean, over that number; twice of it in one case of sixteen.
CLEAR_SIGMAS, FITTED_LOG_LIKELIHOOD = 2.5, 6.0 / FIRST_REFINEMENT[0]
# Poses that few points have refined are told apart for sure where so many times as many points speak against them, and
# would though each were that many widths nearer to the target: refining on more moves them by a seventh of one, where
# the steps have come to rest. They have where the second one on more points moves none of them that far: on one ring,
# of which few faces hold the rotation, they had 16 widths to go.
CERTAIN_POINT_RATIO, MAX_MOVE_WIDTHS = 2.0, 0.5
# Times that number, of a fifth of the points and fewer: what so few say all the others say too.
FEW_POINTS_FACTOR = 2.0
# First kernel scale of the refinement, in sizes.
FIRST_SCALE_DIAGONALS = 6e-3
# Points, steps and first kernel scale of mirrors that may leave little of a part in place.
FAR_MIRROR_REFINEMENT = (300, 1_000, 10), 5e-2
# Flips within so much mean log-likelihood are equally likely: half of what the notch of a block costs that is 0.7 % of
# its surface. What only a smaller fraction of the points favours is no decision.
EQUAL_LOG_LIKELIHOOD = 0.015


def flipped_poses(
    T_target_source: FloatArray,
    flips: FloatArray,
    scan: Scan,
    surface: Surface,
    limit: float,
    floor: float,
    asked: tuple[FloatArray, FloatArray] | None = None,
    scale: float = np.inf,
) -> list[tuple[FloatArray, float]]:
    """Flips, (k, 4, 4), of a pose that explain the scan as well as it does, or better, each with its rms.

    They are refined down to the kernel scale of the pose: where the part is deformed, a wider one draws them aside.

    Where it is known of points, (n, 3), of the scan how far the pose puts them from the target, (n,), flips are left
    out that these tell apart.
    """
    flips = _worth_refining(T_target_source, flips, scan, surface) if len(flips) else flips
    if not len(flips):
        return []
    poses, scores = _refined(
        T_target_source, flips, scan, surface, limit, floor, FIRST_REFINEMENT, asked=asked, scale=scale
    )
    kept = _not_clearly_worse(scores, 0)
    if len(kept) and asked is not None:
        clear = scores.distinguishable(0, FEW_POINTS_FACTOR * CERTAIN_POINT_RATIO)[1 + kept]
        kept = kept[~_told_apart(poses[1 + kept], clear, scores.width, surface, limit, *asked)]
    flips = flips[kept]
    if not len(flips):
        return []
    poses, scores = _refined(T_target_source, flips, scan, surface, limit, floor, scale=scale)
    rms = np.sqrt((scores.distances**2).mean(axis=1))
    likely = np.flatnonzero(scores.as_likely(0, EQUAL_LOG_LIKELIHOOD)[1:]) + 1
    return [(pose.from_parts(poses.R[k], poses.t[k]), float(rms[k])) for k in likely]


def gain_of_mirror(
    T_target_source: FloatArray, mirrors: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> float:
    """Mean log-likelihood that the scan gains by the best of some mirrors, (k, 4, 4)."""
    if not len(mirrors):
        return -np.inf
    scores = _refined(T_target_source, mirrors, scan, surface, limit, floor, FIRST_REFINEMENT)[1]
    best = 1 + int(scores.means[1:].argmax())
    if not len(_not_clearly_worse(scores, 0)):
        return float(scores.means[best] - scores.means[0])
    mirrors = mirrors[_not_clearly_worse(scores, best)]
    means = _refined(T_target_source, mirrors, scan, surface, limit, floor, MIRROR_REFINEMENT)[1].means
    return float(means[1:].max() - means[0])


def far_mirrors(
    T_target_source: FloatArray, mirrors: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> FloatArray:
    """Mirrors that explain the scan clearly better than its pose, once the scan has been refined under each, (k, 4, 4).

    What is no mirror image of itself is drawn aside in its mirror, so they are refined from farther off.
    """
    poses, scores = _refined(
        T_target_source, mirrors, scan, surface, limit, floor, FAR_MIRROR_REFINEMENT[0], FAR_MIRROR_REFINEMENT[1]
    )
    deficit, error = scores.deficit(0)
    rows = np.flatnonzero(-deficit > EQUAL_LOG_LIKELIHOOD + CLEAR_SIGMAS * error)
    return np.asarray(poses.matrices[rows] @ pose.inverse(T_target_source))


def _refined(
    T_target_source: FloatArray,
    maps: FloatArray,
    scan: Scan,
    surface: Surface,
    limit: float,
    floor: float,
    points: tuple[int, int, int] = LAST_REFINEMENT,
    wide: float = FIRST_SCALE_DIAGONALS,
    asked: tuple[FloatArray, FloatArray] | None = None,
    scale: float = np.inf,
) -> tuple[Poses, PoseScores]:
    """A pose, then the pose followed by each of some motions, (k, 4, 4), and refined; and the scores of all.

    Where distances of many points at the pose are known, see `flipped_poses`, some of those points compare.
    """
    how = Refinement(wide, points[2], points[0])
    sample, widths = how.sample(scan.points), how.widths(surface.diagonal)
    if 0.0 < scale < widths[-1]:
        halvings = int(np.ceil(np.log2(widths[-1] / scale)))
        widths = np.concatenate([widths, np.geomspace(widths[-1], scale, halvings + 1)[1:]])
    refined = refine(Poses.of(maps @ T_target_source), sample, surface, widths)
    poses = Poses.of(T_target_source[None]) + refined
    if asked is None or len(asked[0]) < points[1]:
        return poses, score_poses(poses, scan.points[sample_rows(len(scan), points[1])], surface, limit, floor)
    rows = sample_rows(len(asked[0]), points[1])
    there = distances_at(refined, np.take(asked[0], rows, axis=0), surface, limit)
    return poses, scored(np.concatenate([asked[1][None, rows], there]), limit, floor)


def _not_clearly_worse(scores: PoseScores, best: int) -> IntArray:
    """Which motions of a pose few points leave about as likely as one of the poses scored, the pose and each motion."""
    deficit, error = scores.deficit(best)
    return np.flatnonzero((deficit <= EQUAL_LOG_LIKELIHOOD + FITTED_LOG_LIKELIHOOD + CLEAR_SIGMAS * error)[1:])


def _told_apart(
    poses: Poses,
    clear: BoolArray,
    width: float,
    surface: Surface,
    limit: float,
    points: FloatArray,
    distances: FloatArray,
) -> BoolArray:
    """Which poses points tell for sure from the one that puts them at some distances, (n,); see `PoseScores`.

    Where few points have told a pose clearly before, few are asked first: as a rule they say it again.
    """
    some, last = (
        points[sample_rows(len(points), LAST_REFINEMENT[0])],
        np.array([LAST_SCALE_DIAGONALS * surface.diagonal]),
    )
    before = refine(poses, OrientedPoints.on_faces(some), surface, last)
    poses = refine(before, OrientedPoints.on_faces(some), surface, last)
    told: BoolArray = np.abs(poses.apply(some) - before.apply(some)).max(axis=(1, 2)) <= MAX_MOVE_WIDTHS * width
    known = np.zeros(len(poses), dtype=bool)
    # Only those that have come to rest are asked about.
    few = (
        told & clear & (len(points) > 2 * LAST_REFINEMENT[0]),
        sample_rows(len(points), LAST_REFINEMENT[0]),
        FEW_POINTS_FACTOR * CERTAIN_POINT_RATIO,
    )
    for which, asked, surely in (few, (told, slice(None), CERTAIN_POINT_RATIO)):
        if not (rests := np.flatnonzero(which & ~known)).size:
            continue
        there = np.maximum(distances_at(poses[rests], points[asked], surface, limit) - MAX_MOVE_WIDTHS * width, 0.0)
        scores = likely_by(np.concatenate([distances[None, asked], there]), width, limit)
        known[rests] = scores.distinguishable(0, surely)[1:]
    return told & known


def _worth_refining(T_target_source: FloatArray, flips: FloatArray, scan: Scan, surface: Surface) -> FloatArray:
    # A flip that leaves one point in six off the part is nowhere near as likely, whatever its refinement mends.
    for count, lacks in SCREEN_ROUNDS:
        if len(flips):
            few = scan.points[sample_rows(len(scan), count)]
            poses = Poses.of(T_target_source[None]) + Poses.of(flips @ T_target_source)
            gains = mean_gains(poses, few, surface, SCREEN_REACH_DIAGONALS)
            flips = flips[gains[1:] >= gains[0] - lacks]
    return flips
