"""Robust kernels: how much a pair at a given distance counts, and what it costs.

A kernel is a frozen value with two methods: ``cost(d)``, scaled so that a small distance costs ``weight(0) d^2``, and
``weight(d) = cost'(d) / (2 d)``, the factor of the iteratively re-weighted closed form. Because the one is the
derivative of the other, a weighted step can only lower the cost. ``weight(0)`` is one, but for the mixture: there it
is the probability that an exact pair is an inlier.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

import numpy as np

from dqreg._arrays import FloatArray

# Keeps the mixture's two populations alive, so that a pair's weight can always come back.
LEAST_SHARE = 1e-3
# A round of EM that changes scale and share by less is the last: rounding, far below what either is good to.
STILL = 1e-10


class Kernel(Protocol):
    """A robust kernel of distances."""

    @property
    def scale(self) -> float:
        """Distance about which the kernel starts to doubt a pair; infinity for none."""
        ...

    def weight(self, distances: FloatArray) -> FloatArray:
        """Weight of each pair, between 0 and 1."""
        ...

    def cost(self, distances: FloatArray) -> FloatArray:
        """Cost of each pair, a length squared."""
        ...


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """No doubt: every pair counts, the cost is the squared distance."""

    scale: float = np.inf

    def weight(self, distances: FloatArray) -> FloatArray:
        """One for every pair."""
        return np.ones_like(distances)

    def cost(self, distances: FloatArray) -> FloatArray:
        """Squared distance."""
        return distances**2


@dataclasses.dataclass(frozen=True)
class Huber:
    """Squares up to the scale, linear beyond: convex, so it adds no minima of its own (Huber 1964)."""

    scale: float

    def weight(self, distances: FloatArray) -> FloatArray:
        """One up to the scale, then falling like 1/d."""
        return self.scale / np.maximum(distances, self.scale)

    def cost(self, distances: FloatArray) -> FloatArray:
        """Squared distance up to the scale, then its tangent."""
        return np.where(distances <= self.scale, distances**2, self.scale * (2.0 * distances - self.scale))


@dataclasses.dataclass(frozen=True)
class Welsch:
    """Fades like a Gaussian and never quite rejects (Dennis and Welsch 1978)."""

    scale: float

    def weight(self, distances: FloatArray) -> FloatArray:
        """``exp(-(d/scale)^2)``."""
        weights: FloatArray = np.exp(-((distances / self.scale) ** 2))
        return weights

    def cost(self, distances: FloatArray) -> FloatArray:
        """``scale^2 (1 - exp(-(d/scale)^2))``."""
        cost: FloatArray = -(self.scale**2) * np.expm1(-((distances / self.scale) ** 2))
        return cost


@dataclasses.dataclass(frozen=True)
class Tukey:
    """Fades to exactly zero at the scale (Beaton and Tukey 1974)."""

    scale: float

    def weight(self, distances: FloatArray) -> FloatArray:
        """``(1 - (d/scale)^2)^2``, zero beyond the scale."""
        weights: FloatArray = np.maximum(1.0 - (distances / self.scale) ** 2, 0.0) ** 2
        return weights

    def cost(self, distances: FloatArray) -> FloatArray:
        """``scale^2/3 (1 - (1 - (d/scale)^2)^3)``, constant beyond the scale."""
        part = np.minimum((distances / self.scale) ** 2, 1.0)
        # Multiplied out: the difference from one would lose the small distances.
        cost: FloatArray = self.scale**2 * part * (1.0 - part + part**2 / 3.0)
        return cost


@dataclasses.dataclass(frozen=True)
class InlierMixture:
    """Inliers with Gaussian distances among outliers spread evenly up to a limit.

    The cost is ``-2 sigma^2 log(density)`` up to a constant, so its weights are the probabilities that a pair is an
    inlier, and re-weighting is the EM algorithm. Scale and share are learned from the distances themselves: a scan in
    which three quarters of the points belong to the table needs no threshold set by hand.
    """

    scale: float  # Standard deviation sigma of the inliers' distances
    share: float  # Share of inliers among the pairs within the limit
    limit: float  # Largest distance at which a pair is looked at

    @property
    def _odds(self) -> float:
        # Density of outliers over that of an inlier at distance zero (a half-normal).
        return (1.0 - self.share) / self.limit * self.scale * math.sqrt(math.pi / 2.0) / self.share

    def weight(self, distances: FloatArray) -> FloatArray:
        """Probability that the pair is an inlier."""
        inlier = np.exp(-0.5 * (distances / self.scale) ** 2)
        weights: FloatArray = inlier / (inlier + self._odds)
        return weights

    def cost(self, distances: FloatArray) -> FloatArray:
        """``-2 sigma^2 log((density at d) / (density at 0))``."""
        inlier = np.exp(-0.5 * (distances / self.scale) ** 2)
        cost: FloatArray = -2.0 * self.scale**2 * np.log((inlier + self._odds) / (1.0 + self._odds))
        return cost

    def surprise(self, distances: FloatArray, rejected: int) -> float:
        """Mean negative log-likelihood of pairs, the lower the better they are explained."""
        total = len(distances) + rejected
        share = self.share * len(distances) / total
        outlier = (1.0 - share) / self.limit
        inlier = np.sqrt(2.0 / np.pi) / self.scale * share * np.exp(-0.5 * (distances / self.scale) ** 2)
        return float(-(np.log(inlier + outlier).sum() + rejected * np.log(outlier)) / total)

    def learned(self, distances: FloatArray, *, floor: float = 0.0, rounds: int = 1) -> InlierMixture:
        """The mixture after EM rounds on the given distances."""
        mixture = self
        for _ in range(rounds):
            weights = mixture.weight(distances)
            total = float(weights.sum())
            if total == 0.0:
                break
            scale = max(float(np.sqrt(weights @ distances**2 / total)), floor, np.finfo(float).tiny)
            share = min(max(total / len(distances), LEAST_SHARE), 1.0 - LEAST_SHARE)
            settled = abs(scale - mixture.scale) <= STILL * scale and abs(share - mixture.share) <= STILL * share
            mixture = InlierMixture(scale, share, self.limit)
            if settled:
                break
        return mixture
