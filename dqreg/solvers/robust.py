"""Robust kernels: the weight and the cost of a correspondence by its distance.

A kernel is a frozen value with two methods: ``cost(d)``, scaled so that a small distance costs ``weight(0) d^2``, and
``weight(d) = cost'(d) / (2 d)``, the factor of the iteratively re-weighted closed form. Because the one is the
derivative of the other, a weighted step can only lower the cost. ``weight(0)`` is one, but for the mixture: there it
is the probability that an exact correspondence is an inlier.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

import numpy as np

from dqreg._arrays import FloatArray

# Keeps both populations of the mixture alive, so that the weight of a correspondence can always come back.
LEAST_FRACTION = 1e-3
# An EM round that changes scale and inlier fraction by less is the last: both are good to a percent of some thousand
# distances, and what goes on in rounds of its own ends no sooner than they stand still.
SETTLED_SHARE = 1e-8
# Where a fit starts: half of the points inliers, and a scale at which no distance within the limit is given up yet (at
# the limit the Gaussian is exp(-2) of its peak), so that EM only has to narrow it.
FIRST_INLIER_FRACTION, FIRST_SCALE_LIMITS = 0.5, 0.5
# The least scale: its square would be zero, but no distance is divided by zero.
TINY = float(np.finfo(float).tiny)
# What squares of distances are multiplied with at most: infinity times zero is no number.
MIN_SQUARE_FACTOR = -1e300
# One over the density of a half-normal distance of standard deviation 1 at zero.
HALF_NORMAL = math.sqrt(math.pi / 2.0)
# Standard deviation of a Gaussian over the median of its distances from zero.
GAUSSIAN_MEDIAN = 1.4826


def scatter_of(values: FloatArray) -> float:
    """Standard deviation of Gaussian numbers, (n,), about their median, which half of them may lie far from.

    >>> scatter_of(np.array([0.0, 1.0, 2.0, 1e9]))
    1.4826
    """
    return GAUSSIAN_MEDIAN * float(np.median(np.abs(values - np.median(values))))


class Kernel(Protocol):
    """A robust kernel of distances."""

    @property
    def scale(self) -> float:
        """Distance about which weights start to fall; infinity for none."""
        ...

    def weight(self, distances: FloatArray) -> FloatArray:
        """Weight of each distance, between 0 and 1."""
        ...

    def cost(self, distances: FloatArray) -> FloatArray:
        """Cost of each distance, a length squared."""
        ...


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """Every correspondence counts alike, the cost is the squared distance."""

    scale: float = np.inf

    def weight(self, distances: FloatArray) -> FloatArray:
        """One for every distance."""
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
class GemanMcClure:
    """Fades like 1/d^4, so that what the fit explains badly is doubted but never quite rejected (1985)."""

    scale: float

    @classmethod
    def of_median(cls, distances: FloatArray, floor: float) -> GemanMcClure:
        """The kernel under which about half of the distances count fully: twice their robust standard deviation."""
        return cls(2.0 * max(GAUSSIAN_MEDIAN * float(np.median(distances)), floor))

    def weight(self, distances: FloatArray) -> FloatArray:
        """``(1 + (d/scale)^2)^-2``."""
        weights: FloatArray = (1.0 + (distances / self.scale) ** 2) ** -2
        return weights

    def cost(self, distances: FloatArray) -> FloatArray:
        """``d^2 / (1 + (d/scale)^2)``, at most the scale squared."""
        cost: FloatArray = distances**2 / (1.0 + (distances / self.scale) ** 2)
        return cost


def odds_of(scale: float, inlier_fraction: float, limit: float) -> float:
    """Density of outliers over that of an inlier at distance zero (a half-normal)."""
    return (1.0 - inlier_fraction) / limit * scale * HALF_NORMAL / inlier_fraction


@dataclasses.dataclass(frozen=True)
class InlierMixture:
    """Inliers with Gaussian distances among outliers that are uniform up to a limit.

    The cost is ``-2 sigma^2 log(density)`` up to a constant, so its weights are the probabilities that a
    correspondence is an inlier, and re-weighting is the EM algorithm. Scale and inlier fraction are fitted to the
    distances: a scan in which three quarters of the points belong to the table needs no threshold set by hand.
    """

    scale: float  # Standard deviation sigma of the inliers' distances
    inlier_fraction: float  # Of inliers among the correspondences within the limit
    limit: float  # Largest distance of a correspondence

    @classmethod
    def starting(cls, scale: float, limit: float) -> InlierMixture:
        """Start of a fit at a given scale, with nothing known about the fraction of inliers."""
        return cls(scale, FIRST_INLIER_FRACTION, limit)

    @classmethod
    def widest(cls, limit: float, floor: float) -> InlierMixture:
        """Start of a fit of which nothing is known, at a scale of at least the floor."""
        return cls.starting(max(FIRST_SCALE_LIMITS * limit, floor), limit)

    @property
    def odds(self) -> float:
        """Density of outliers over that of an inlier at distance zero (a half-normal)."""
        return odds_of(self.scale, self.inlier_fraction, self.limit)

    def weight(self, distances: FloatArray) -> FloatArray:
        """Probability of an inlier."""
        inlier = np.exp(-0.5 * (distances / self.scale) ** 2)
        weights: FloatArray = inlier / (inlier + self.odds)
        return weights

    def cost(self, distances: FloatArray) -> FloatArray:
        """``-2 sigma^2 log((density at d) / (density at 0))``."""
        inlier = np.exp(-0.5 * (distances / self.scale) ** 2)
        cost: FloatArray = -2.0 * self.scale**2 * np.log((inlier + self.odds) / (1.0 + self.odds))
        return cost

    def mean_nll(self, distances: FloatArray, rejected: int) -> float:
        """Mean negative log-likelihood of distances within the limit and of so many beyond it; lower is better."""
        total = len(distances) + rejected
        fraction = self.inlier_fraction * len(distances) / total
        outlier = (1.0 - fraction) / self.limit
        inlier = np.sqrt(2.0 / np.pi) / self.scale * fraction * np.exp(-0.5 * (distances / self.scale) ** 2)
        return float(-(np.log(inlier + outlier).sum() + rejected * np.log(outlier)) / total)

    def fit(self, distances: FloatArray, *, floor: float = 0.0, rounds: int = 1) -> InlierMixture:
        """Scale and inlier fraction after EM rounds on distances within the limit."""
        from dqreg.kernels.steps.mixture_fits import fit_mixture
        from dqreg.kernels.threads import as_plain

        mixture = max(self.scale, TINY), self.inlier_fraction, self.limit
        limits = HALF_NORMAL, max(floor, TINY), LEAST_FRACTION, MIN_SQUARE_FACTOR, SETTLED_SHARE
        scale, fraction = fit_mixture(as_plain(distances), *mixture, rounds, *limits)
        return InlierMixture(scale, fraction, self.limit)

    def inlier_densities(self, distances: FloatArray) -> FloatArray:
        """Density of each distance among the inliers, of any shape; 0 from the limit on."""
        inlier = np.sqrt(2.0 / np.pi) / self.scale * np.exp(-0.5 * (distances / self.scale) ** 2)
        densities: FloatArray = inlier * (distances < self.limit)
        return densities
