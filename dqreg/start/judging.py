"""The judge of the search: which of several poses explains all points of the scan best, and which as well."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry import Surface
from dqreg.icp import InlierMixture


@dataclasses.dataclass(frozen=True)
class Judgement:
    """How some poses explain the same points, all by one and the same width.

    Attributes
    ----------
    likelihoods : ndarray, (n, m)
        Log-likelihood of each point under each pose.
    distances : ndarray, (n, m)
        Distances to the target, cut off at the limit.
    width : float
        Standard deviation of the distances under the pose that explains them best.
    """

    likelihoods: FloatArray
    distances: FloatArray
    width: float

    @property
    def means(self) -> FloatArray:
        """Mean log-likelihood under each pose, (n,); the higher the better."""
        means: FloatArray = self.likelihoods.mean(axis=1)
        return means

    def behind(self, best: int, blocks: int = 60) -> tuple[FloatArray, FloatArray]:
        """How far each pose stays behind one of them, in mean log-likelihood, and the standard error of that.

        Neighbouring points err together (they stand on one face of a part that is not quite its drawing), so the error
        is taken from blocks of neighbours.
        """
        gaps = self.likelihoods[best] - self.likelihoods
        edges = np.linspace(0, gaps.shape[1], min(blocks, gaps.shape[1]) + 1).astype(np.int64)[:-1]
        counts = np.diff(np.append(edges, gaps.shape[1]))
        means = np.add.reduceat(gaps, edges, axis=1) / counts
        error = means.std(axis=1, ddof=1) / np.sqrt(len(edges)) if len(edges) > 1 else np.zeros(len(gaps))
        return gaps.mean(axis=1), error


def weigh_up(
    R: FloatArray, t: FloatArray, points: FloatArray, surface: Surface, limit: float, floor: float
) -> Judgement:
    """Likelihood of every point under every pose.

    Parameters
    ----------
    R : ndarray, (n, 3, 3)
        Rotations, n >= 1.
    t : ndarray, (n, 3)
        Translations.
    points : ndarray, (m, 3)
        Points of the scan in Morton order.
    surface : Surface
        Target.
    limit : float
        Distance beyond which a point tells nothing more.
    floor : float
        Smallest width.

    Returns
    -------
    Judgement
        One row a pose.
    """
    distances = np.stack([surface.closest(points @ R[k].T + t[k]).distances for k in range(len(R))])
    cut = np.minimum(distances, limit)
    learned = [_learned(row, limit, floor) for row in distances]
    best = max(learned, key=lambda pair: pair[0])[1]
    # One width for all: else a wrong pose could call its misfit noise.
    rows = [_likelihoods(row, limit, best.scale) for row in distances]
    return Judgement(np.stack(rows), cut, best.scale)


def _learned(distances: FloatArray, limit: float, floor: float) -> tuple[float, InlierMixture]:
    near = distances < limit
    start = InlierMixture(0.2 * limit, 0.5, limit)
    if not near.any():
        return -np.inf, start
    mixture = start.learned(distances[near], floor=floor, rounds=60)
    return -mixture.surprise(distances[near], int(np.count_nonzero(~near))), mixture


def _likelihoods(distances: FloatArray, limit: float, width: float) -> FloatArray:
    inlier = np.sqrt(2.0 / np.pi) / width * np.exp(-0.5 * (distances / width) ** 2) * (distances < limit)
    share = 0.5
    for _ in range(20):
        share = float(np.clip((share * inlier / (share * inlier + (1.0 - share) / limit)).mean(), 1e-3, 1.0 - 1e-3))
    likelihoods: FloatArray = np.log(share * inlier + (1.0 - share) / limit)
    return likelihoods
