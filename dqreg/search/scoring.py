"""Scores of poses: the likelihood of the points of the scan under each, all by one width of the distances."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import MeshSurface, Surface
from dqreg.geometry.surface import Closest
from dqreg.icp import InlierMixture
from dqreg.search.poses import Poses
from dqreg.solvers.robust import LEAST_FRACTION

# Points farther from the target than this fraction of the largest distance of a correspondence are outliers to a score.
OUTLIER_DISTANCE_SHARE = 0.25
# Poses for which a width is estimated.
WIDTH_POSES = 6
# Kernel scale that their fit starts at, in units of the limit: the poses are refined ones.
INITIAL_SCALE_SHARE = 0.2
# EM rounds that fit the fraction of inliers of each pose.
EM_ROUNDS = 20
# Normals farther apart than this are of different faces.
MAX_NORMAL_ANGLE_RAD = np.deg2rad(50.0)
# A point favours one of two poses clearly with this log-likelihood ratio.
CLEAR_LOG_RATIO = 2.0
# So many such points are enough to tell the poses apart if their sum is so many times that of the points that favour
# the other one.
CLEAR_POINTS, CLEAR_SUM_RATIO = 30, 10.0
# Few are enough that lie on the target at the pose they favour, within so many widths, and off it at the other one:
# outliers hardly do.
FEW_CLEAR_POINTS, ON_TARGET_WIDTHS = 3, 3.0
# Their ratios together are such as chance reaches once in 10^8.
CHANCE_LOG_RATIO = 20.0
# A pose within so many standard errors of another one's mean log-likelihood is as likely, but never one farther behind
# than the last number.
EQUAL_SIGMAS, MAX_EQUAL_LOG_LIKELIHOOD = 2.0, 0.05
# One this close to the best is equally likely, whatever its standard error.
EQUAL_LOG_LIKELIHOOD = 0.02
# Blocks of neighbouring points whose errors are taken as independent.
ERROR_BLOCKS = 60


@dataclasses.dataclass(frozen=True)
class PoseScores:
    """How some poses explain the same points."""

    likelihoods: FloatArray  # (n, m): Log-likelihood of each point under each pose
    distances: FloatArray  # (n, m): Distances to the target, cut off at the limit
    width: float  # Standard deviation of the distances under the pose that explains them best

    @property
    def means(self) -> FloatArray:
        """Mean log-likelihood under each pose, (n,); the higher the better."""
        means: FloatArray = self.likelihoods.mean(axis=1)
        return means

    def deficit(self, best: int) -> tuple[FloatArray, FloatArray]:
        """Mean log-likelihood that each pose lacks against one of them, and the standard error of that.

        Only points that some pose puts near the target count: in a scene all others are the same to all poses. Errors
        of neighbouring points are correlated (a face of the part may deviate from its model), so the standard error is
        taken from blocks of neighbours.
        """
        near, gaps = self.distances.min(axis=0) < self.distances.max(), self.likelihoods[best] - self.likelihoods
        if near.any() and not near.all():
            gaps = gaps[:, near]
        count = min(ERROR_BLOCKS, gaps.shape[1])
        edges = np.arange(count + 1) * gaps.shape[1] // count
        means = np.add.reduceat(gaps, edges[:-1], axis=1) / np.diff(edges)
        error = means.std(axis=1, ddof=1) / np.sqrt(count) if count > 1 else np.zeros(len(gaps))
        return gaps.mean(axis=1), error

    def as_likely(self, best: int, least: float) -> BoolArray:
        """Which poses, (n,), are as likely as one of them by their means: all that lack so much of it at most, too."""
        deficit, error = self.deficit(best)
        return np.asarray(deficit <= np.clip(EQUAL_SIGMAS * error, least, MAX_EQUAL_LOG_LIKELIHOOD))

    def distinguishable(self, best: int, surely: float = 1.0) -> BoolArray:
        """Which poses are clearly worse than one of them at some points, and better at next to none, (n,).

        A notch is seen by few points, all in a few blocks: their mean is small and its error large, but no point
        favours the other pose. Where the part deviates from its model, some points favour either. Surely, where so
        many times as many speak against it.
        """
        gaps = self.likelihoods[best] - self.likelihoods
        clear = np.abs(gaps) > CLEAR_LOG_RATIO
        against, in_favour = clear & (gaps > 0.0), clear & (gaps < 0.0)
        weights = np.where(against, gaps, 0.0).sum(axis=1), np.where(in_favour, -gaps, 0.0).sum(axis=1)
        clearly: BoolArray = (np.count_nonzero(against, axis=1) >= surely * CLEAR_POINTS) & (
            weights[0] > CLEAR_SUM_RATIO * weights[1]
        )
        return clearly | self._told_by_few(best, gaps, clear, surely)

    def _told_by_few(self, best: int, gaps: FloatArray, clear: BoolArray, surely: float) -> BoolArray:
        """The same by points that lie on the target at one pose and off it at the other: one hole is seen by few."""
        on = self.distances <= ON_TARGET_WIDTHS * self.width
        against, in_favour = clear & (gaps > 0.0) & on[best] & ~on, clear & (gaps < 0.0) & on & ~on[best]
        ratio, other = np.where(against, gaps, 0.0).sum(axis=1), np.where(in_favour, -gaps, 0.0).sum(axis=1)
        is_enough = (np.count_nonzero(against, axis=1) >= surely * FEW_CLEAR_POINTS) & (
            ratio >= surely * CHANCE_LOG_RATIO
        )
        return np.asarray(is_enough & (ratio > CLEAR_SUM_RATIO * other))


def symmetric_scores(there: PoseScores, back: PoseScores) -> PoseScores:
    """Scores by the points of both sides together, each point with the same weight."""
    likelihoods = np.concatenate([there.likelihoods, back.likelihoods], axis=1)
    return PoseScores(likelihoods, np.concatenate([there.distances, back.distances], axis=1), there.width)


def score_poses(
    poses: Poses,
    points: FloatArray,
    surface: Surface,
    limit: float,
    floor: float,
    directions: FloatArray | None = None,
) -> PoseScores:
    """Likelihood of every point under every pose.

    ``floor`` is the smallest width; with directions it is the width, and points whose normals disagree are outliers.
    """
    if directions is not None:
        return _by_normals(poses, points, directions, surface, limit, floor)
    return scored(distances_at(poses, points, surface, limit), limit, floor)


def scored(distances: FloatArray, limit: float, floor: float) -> PoseScores:
    """The same of poses with such distances, (k, n)."""
    # The width is that of the pose under which the points are likeliest: one of those with the smallest distances.
    few = np.argsort(np.sqrt(np.minimum(distances, limit)).mean(axis=1), kind="stable")[:WIDTH_POSES]
    learned = [_learned(row, limit, floor) for row in distances[few]]
    # One width for all: else a wrong pose could explain its misfit as noise.
    return likely_by(distances, max(learned, key=lambda pair: pair[0])[1].scale, limit)


def distances_at(
    poses: Poses, points: FloatArray, surface: Surface, limit: float, *, by_point: bool = False
) -> FloatArray:
    """How far each of k poses puts points from the target, (k, n), infinite from the limit on.

    By point, where each pose is near the one before it: a mesh is asked in that order.
    """
    # Farther off than the limit, how far does not matter.
    if isinstance(surface, MeshSurface):
        return surface._distances_at(poses.R, poses.t, points, limit, by_point=by_point)
    return _moved(poses, points, surface, limit).distances.reshape(len(poses), len(points))


def likely_by(distances: FloatArray, width: float, limit: float) -> PoseScores:
    """How poses with such distances, (k, n), explain the points by a width."""
    likelihoods = _likelihoods(distances, InlierMixture.starting(width, limit))
    return PoseScores(likelihoods, np.minimum(distances, limit), width)


def _moved(poses: Poses, points: FloatArray, surface: Surface, limit: float) -> Closest:
    # In one query, so that threads share it.
    return surface.closest(poses.apply(points).reshape(-1, 3), within=limit)


def _by_normals(
    poses: Poses, points: FloatArray, directions: FloatArray, surface: Surface, limit: float, width: float
) -> PoseScores:
    found = _moved(poses, points, surface, limit)
    distances = found.distances.reshape(len(poses), -1).copy()
    unknown = np.asarray(~directions.any(axis=1))
    for k, normals in enumerate(found.normals.reshape(len(poses), -1, 3)):
        cosines = np.abs(np.einsum("ij,ij->i", directions @ poses.R[k].T, normals))
        distances[k, ~(unknown | (cosines > np.cos(MAX_NORMAL_ANGLE_RAD)))] = np.inf
    return likely_by(distances, width, limit)


def mean_gains(poses: Poses, points: FloatArray, surface: Surface, reach: float) -> FloatArray:
    """Mean of ``1 - (d / reach)^2``, 0 beyond the reach in sizes, of points under each of n poses, (n,)."""
    return np.asarray(
        gains_of(distances_at(poses, points, surface, reach * surface.diagonal), surface, reach).mean(axis=1)
    )


def gains_of(distances: FloatArray, surface: Surface, reach: float) -> FloatArray:
    """``1 - (d / reach)^2`` for such distances, 0 beyond the reach in sizes."""
    return np.asarray(np.maximum(1.0 - (distances / (reach * surface.diagonal)) ** 2, 0.0))


def _likelihoods(distances: FloatArray, mixture: InlierMixture) -> FloatArray:
    from dqreg.kernels.search.many_poses import log_likelihoods
    from dqreg.kernels.threads import over_chunks

    found = mixture.inlier_densities(distances)
    outlier = 1.0 / mixture.limit
    over_chunks(
        log_likelihoods, len(found), found, outlier, mixture.inlier_fraction, LEAST_FRACTION, EM_ROUNDS, chunk=1
    )
    return found


def _learned(distances: FloatArray, limit: float, floor: float) -> tuple[float, InlierMixture]:
    near = distances < limit
    start = InlierMixture.starting(INITIAL_SCALE_SHARE * limit, limit)
    if not near.any():
        return -np.inf, start
    mixture = start.fit(distances[near], floor=floor, rounds=60)
    return -mixture.mean_nll(distances[near], int(np.count_nonzero(~near))), mixture
