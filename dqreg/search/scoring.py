"""The judge of the search: which of several poses explains all points of the scan best, and which as well."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Surface
from dqreg.icp import InlierMixture

# Poses whose widths are learned.
LEARNED = 6
# Kernel scale that their fit starts at, in units of the limit: the poses are refined ones.
NARROW = 0.2
# EM rounds that fit the fraction of inliers of each pose.
ROUNDS = 20
# Normals farther apart than this are of different faces.
GATE_RAD = np.deg2rad(50.0)
# A point speaks clearly for one of two poses with this log-likelihood between them; so many points are enough if what
# they say is so many times what speaks against them.
CLEAR, WITNESSES, UNANIMOUS = 2.0, 30, 10.0


@dataclasses.dataclass(frozen=True)
class Judgement:
    """How some poses explain the same points, all by one and the same width."""

    likelihoods: FloatArray  # (n, m): Log-likelihood of each point under each pose
    distances: FloatArray  # (n, m): Distances to the target, cut off at the limit
    width: float  # Standard deviation of the distances under the pose that explains them best

    @property
    def means(self) -> FloatArray:
        """Mean log-likelihood under each pose, (n,); the higher the better."""
        means: FloatArray = self.likelihoods.mean(axis=1)
        return means

    def behind(self, best: int, blocks: int = 60) -> tuple[FloatArray, FloatArray]:
        """How far each pose stays behind one of them, in mean log-likelihood, and the standard error of that.

        Only points that one of the poses puts near the target have a say: in a scene all others are the same to all
        poses. Neighbouring points err together (they stand on one face of a part that is not quite its drawing), so the
        error is taken from blocks of neighbours.
        """
        said = self.distances.min(axis=0) < self.distances.max()
        if not said.any():
            said[:] = True
        gaps = (self.likelihoods[best] - self.likelihoods)[:, said]
        edges = np.linspace(0, gaps.shape[1], min(blocks, gaps.shape[1]) + 1).astype(np.int64)[:-1]
        counts = np.diff(np.append(edges, gaps.shape[1]))
        means = np.add.reduceat(gaps, edges, axis=1) / counts
        error = means.std(axis=1, ddof=1) / np.sqrt(len(edges)) if len(edges) > 1 else np.zeros(len(gaps))
        return gaps.mean(axis=1), error

    def told_apart(self, best: int) -> BoolArray:
        """Which poses some points speak clearly against, and next to none for, (n,).

        A notch is seen by few points, which all stand in a few blocks: their mean says little and its error is large,
        but nothing speaks for the other pose. Where the part is not quite its drawing, points speak for either.
        """
        gaps = self.likelihoods[best] - self.likelihoods
        clear = np.abs(gaps) > CLEAR
        against, in_favour = clear & (gaps > 0.0), clear & (gaps < 0.0)
        weights = np.where(against, gaps, 0.0).sum(axis=1), np.where(in_favour, -gaps, 0.0).sum(axis=1)
        told: BoolArray = (np.count_nonzero(against, axis=1) >= WITNESSES) & (weights[0] > UNANIMOUS * weights[1])
        return told


def both_ways(there: Judgement, back: Judgement) -> Judgement:
    """One judgement of the points of both sides: each side has as much to say as it has points."""
    likelihoods = np.concatenate([there.likelihoods, back.likelihoods], axis=1)
    return Judgement(likelihoods, np.concatenate([there.distances, back.distances], axis=1), there.width)


def weigh_up(
    R: FloatArray,
    t: FloatArray,
    points: FloatArray,
    surface: Surface,
    limit: float,
    floor: float,
    directions: FloatArray | None = None,
) -> Judgement:
    """Likelihood of every point under every pose.

    Shapes: R (n, 3, 3).
    """
    found = [surface.closest(points @ R[k].T + t[k]) for k in range(len(R))]
    distances = np.stack([each.distances for each in found])
    if directions is not None:
        unknown = np.asarray(~directions.any(axis=1))
        for k, each in enumerate(found):
            cosines = np.abs(np.einsum("ij,ij->i", directions @ R[k].T, each.normals))
            distances[k, ~(unknown | (cosines > np.cos(GATE_RAD)))] = np.inf
        cut = np.minimum(distances, limit)
        return Judgement(_likelihoods(distances, InlierMixture.starting(floor, limit)), cut, floor)
    cut = np.minimum(distances, limit)
    # The width is that of the pose under which the points are likeliest: one of those that leave the least over.
    few = np.argsort(np.sqrt(cut).mean(axis=1), kind="stable")[:LEARNED]
    learned = [_learned(row, limit, floor) for row in distances[few]]
    best = max(learned, key=lambda pair: pair[0])[1]
    # One width for all: else a wrong pose could call its misfit noise.
    return Judgement(_likelihoods(distances, InlierMixture.starting(best.scale, limit)), cut, best.scale)


def _likelihoods(distances: FloatArray, mixture: InlierMixture) -> FloatArray:
    return np.stack([mixture.log_likelihoods(row, rounds=ROUNDS) for row in distances])


def _learned(distances: FloatArray, limit: float, floor: float) -> tuple[float, InlierMixture]:
    near = distances < limit
    start = InlierMixture.starting(NARROW * limit, limit)
    if not near.any():
        return -np.inf, start
    mixture = start.fit(distances[near], floor=floor, rounds=60)
    return -mixture.mean_nll(distances[near], int(np.count_nonzero(~near))), mixture
