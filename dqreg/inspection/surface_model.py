"""What noise does to the extremes of a surface: how much wider it makes a zone, at the least and at the most."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.inspection.features.spread import DRAW_SEED
from dqreg.inspection.places import COVERAGE_FACTOR, MEDIAN_SIGMA, PLACE_POINTS

# A neighbourhood on a face holds that part of its points at most.
NEIGHBOURHOODS_PER_FACE = 40
# Places whose medians are asked; more say the same.
MAX_PLACES = 3_000
# Blocks of neighbouring points that the smooth surface is found from, at most.
MAX_BLOCKS = 256
# Correlation lengths that are tried, in extents of the face; and sizes of the form error, in standard deviations of a
# block's noise.
LENGTHS_EXTENTS = 2.0 ** np.arange(-5.0, 1.0)
SIZES_SIGMAS = np.concatenate([[0.0], np.geomspace(0.2, 100.0, 19)])
# What the farthest place is not known by, in standard deviations of one.
UNKNOWN_SIGMAS = 1.2
# Draws of the noise.
NOISE_DRAWS = 60

# One number for each row of values at the places, (d, m).
Statistic = Callable[[FloatArray], FloatArray]


@dataclasses.dataclass(frozen=True, eq=False)
class Medians:
    """Medians of neighbouring points at places of a face: what its surface does, without what single points do."""

    rows: IntArray  # (m,): The point that each place is at
    values: FloatArray  # (m,)
    sigma: float  # Standard deviation of one
    points: FloatArray  # (n, 3)
    around: IntArray  # (m, k): Points of each neighbourhood
    own: FloatArray  # (n,): Values of the points themselves; NaN where a point has none
    noise: float  # Standard deviation of one of these

    @classmethod
    def of(cls, values: FloatArray, points: FloatArray, noise: float) -> Medians:
        """Of a face's values at its points, (n,), (n, 3): neighbourhoods of a fortieth of them, 25 at most.

        A face of few points keeps them as they are: medians over a quarter of a hole would hide its lobes.
        """
        from scipy.spatial import cKDTree

        rows = np.arange(len(values))[:: -(-len(values) // MAX_PLACES)]
        count = int(np.clip(len(values) // NEIGHBOURHOODS_PER_FACE, 1, PLACE_POINTS))
        around = np.asarray(cKDTree(points).query(points[rows], k=[*range(1, count + 1)])[1], dtype=np.int64)
        return cls(
            rows, np.asarray(np.median(values[around], axis=1)), sigma_of(noise, count), points, around, values, noise
        )

    def corrected(self, value: float, statistic: Statistic, unit: float = 1.0) -> tuple[float, float]:
        """A statistic without what noise adds to it, and its expanded uncertainty; one place adds ``unit``.

        Noise adds most to the extremes of a smooth surface, whose many places compete to be the farthest, and least
        where the medians themselves are taken for the surface: one place then is. The truth lies between, as far as
        the place that is the farthest is known itself.
        """
        if self.sigma == 0.0:
            return value, 0.0
        noise = self._draws()
        most, least = (
            float(noisy.mean() - statistic(surface[None])[0])
            for surface in (self._smooth(), self.values)
            for noisy in [statistic(surface + noise)]
        )
        scatter = float(statistic(self.values + noise).std(ddof=1))
        most = max(most, least)
        half = 0.5 * (most - least)
        return max(value - least - half, 0.0), half + COVERAGE_FACTOR * scatter + UNKNOWN_SIGMAS * unit * self.sigma

    def _draws(self) -> FloatArray:
        """Noise of the medians as it might have been, neighbours alike: (draws, m)."""
        rng = np.random.default_rng(DRAW_SEED)
        factor = self.sigma * np.sqrt(self.around.shape[1])
        found = np.zeros((NOISE_DRAWS, len(self.rows)))
        for row in found:
            row[:] = factor * rng.standard_normal(len(self.points))[self.around].mean(axis=1)
        return found

    def _smooth(self) -> FloatArray:
        """The surface by a random field of the likeliest size and correlation length, (m,).

        Gaussian process regression (Rasmussen and Williams 2006, chapter 2 and section 5.4) with the Matern kernel 5/2.
        """
        # Neighbouring medians share points: from them the noise would look like a surface. Blocks do not.
        known = np.isfinite(self.own)
        points, own = self.points[known], self.own[known]
        blocks = blocks_of(points)
        places = np.array([points[each].mean(axis=0) for each in blocks])
        values = np.array([np.median(own[each]) for each in blocks])
        sigma = sigma_of(self.noise, len(blocks[0]))
        middle = float(values.mean())
        away = np.linalg.norm(places[:, None] - places[None], axis=2)
        extent = max(float(away.max()), np.finfo(float).tiny)
        best, chosen = -np.inf, (0.0, np.zeros(len(values)), 1.0)
        for length in LENGTHS_EXTENTS * extent:
            strengths, axes = np.linalg.eigh(matern(away / length))
            square = (axes.T @ (values - middle) / sigma) ** 2
            for size in SIZES_SIGMAS:
                spread = size**2 * np.maximum(strengths, 0.0) + 1.0
                height = -0.5 * float(np.sum(square / spread + np.log(spread)))
                if height > best:
                    pull = axes @ ((axes.T @ (values - middle)) / spread)
                    best, chosen = height, (size, pull, float(length))
        size, pull, length = chosen
        across = np.linalg.norm(self.points[self.rows][:, None] - places[None], axis=2)
        return np.asarray(middle + size**2 * matern(across / length) @ pull)


def sigma_of(noise: float, count: int) -> float:
    """Standard deviation of the median of as many values."""
    # The median of two is their mean; of many it is by a quarter less sure than that.
    loss = 1.0 + (MEDIAN_SIGMA - 1.0) * min((count - 1) / 8.0, 1.0)
    return float(loss * noise / np.sqrt(count))


def matern(h: FloatArray) -> FloatArray:
    """Correlation of a random field at distances in its length (Matern 5/2)."""
    h = np.sqrt(5.0) * h
    return np.asarray((1.0 + h + h**2 / 3.0) * np.exp(-h))


def blocks_of(points: FloatArray) -> list[IntArray]:
    """Points in blocks of neighbours, halved across their longest extent until there are enough."""
    blocks = [np.arange(len(points))]
    while 2 * len(blocks) <= MAX_BLOCKS and len(blocks[0]) >= 2:
        halves: list[IntArray] = []
        for rows in blocks:
            axis = int(np.argmax(np.ptp(points[rows], axis=0)))
            order = rows[np.argsort(points[rows, axis], kind="stable")]
            halves += [order[: len(order) // 2], order[len(order) // 2 :]]
        blocks = [half for half in halves if len(half)]
    return blocks
