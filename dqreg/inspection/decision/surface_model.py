"""What noise does to the extremes of a surface: how much wider it makes a zone, at the least and at the most."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.inspection.decision.places import COVERAGE_FACTOR, MEDIAN_SIGMA, PLACE_POINTS
from dqreg.inspection.features.spread import DRAW_SEED

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
# A face goes on beyond its last points by some of a spacing, in how far the middle of neighbours lies inside of them.
RIM_SHARE = 0.4
# Faces whose modes are kept.
KEPT_FACES = 8
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
    smooth: SmoothSurface | None = None  # That carried them to their places; None where nothing did

    @classmethod
    def of(cls, values: FloatArray, points: FloatArray, noise: float, *, to_rim: bool = False) -> Medians:
        """Of a face's values at its points, (n,), (n, 3): neighbourhoods of a fortieth of them, 25 at most.

        A face of few points keeps them as they are: medians over a quarter of a hole would hide its lobes. At the rim
        of a face neighbours lie to one side: ``to_rim`` carries the median from their middle to the place by the smooth
        surface, and keeps points without noise as they are.
        """
        from scipy.spatial import cKDTree

        rows = np.arange(len(values))[:: -(-len(values) // MAX_PLACES)]
        count = int(np.clip(len(values) // NEIGHBOURHOODS_PER_FACE, 1, PLACE_POINTS))
        if to_rim and noise == 0.0:
            count = 1
        around = np.asarray(cKDTree(points).query(points[rows], k=[*range(1, count + 1)])[1], dtype=np.int64)
        medians = np.asarray(np.median(values[around], axis=1))
        smooth = SmoothSurface.of(values, points, noise) if to_rim and count > 1 else None
        if smooth is not None:
            medians = medians + smooth.at(points[rows]) - smooth.at(points[around].mean(axis=1))
        return cls(rows, medians, sigma_of(noise, count), points, around, values, noise, smooth)

    def corrected(
        self, value: float, statistic: Statistic, unit: float = 1.0, *, flat: FloatArray | None = None
    ) -> tuple[float, float]:
        """A statistic without what noise adds to it, and its expanded uncertainty; one place adds ``unit``.

        Noise adds most to the extremes of a smooth surface, whose many places compete to be the farthest, and least
        where the medians themselves are taken for the surface: one place then is. The truth lies between, as far as
        the place that is the farthest is known itself. ``flat`` is one more surface that it may be, (m,), where more
        places compete than on a smooth one: a step has a plateau.
        """
        if self.sigma == 0.0:
            return value, 0.0
        noise = self._draws()
        least, *more = (
            float(noisy.mean() - statistic(surface[None])[0])
            for surface in (self.values, self._smooth(), *([] if flat is None else [flat]))
            for noisy in [statistic(surface + noise)]
        )
        scatter = float(statistic(self.values + noise).std(ddof=1))
        most = max(least, *more)
        half = 0.5 * (most - least)
        room = half + COVERAGE_FACTOR * scatter + UNKNOWN_SIGMAS * unit * self.sigma
        return max(value - least - half, 0.0), room + self._beyond(statistic)

    def _beyond(self, statistic: Statistic) -> float:
        """By how much a statistic is larger where the face goes on beyond its last points, to its rim."""
        if self.smooth is None:
            return 0.0
        places = self.points[self.rows]
        # At a straight rim the middle of 25 neighbours lies 1.2 spacings inside.
        further = places + RIM_SHARE * (places - self.points[self.around].mean(axis=1))
        on = self.values + self.smooth.at(further) - self.smooth.at(places)
        return max(float(statistic(on[None])[0] - statistic(self.values[None])[0]), 0.0)

    def _draws(self) -> FloatArray:
        """Noise of the medians as it might have been, neighbours alike: (draws, m)."""
        rng = np.random.default_rng(DRAW_SEED)
        factor = self.sigma * np.sqrt(self.around.shape[1])
        found = np.zeros((NOISE_DRAWS, len(self.rows)))
        smooth, steps = self.smooth, np.zeros(0)
        if smooth is not None:
            places, middles = self.points[self.rows], self.points[self.around].mean(axis=1)
            steps = (smooth.kernel(places) - smooth.kernel(middles)) @ smooth.gains
        for row in found:
            drawn = factor * rng.standard_normal(len(self.points))
            row[:] = drawn[self.around].mean(axis=1)
            if smooth is not None:
                row += steps @ smooth.means(drawn)
        return found

    def _smooth(self) -> FloatArray:
        """The surface by a random field, (m,)."""
        # Neighbouring medians share points: from them the noise would look like a surface.
        known = np.isfinite(self.own)
        return SmoothSurface.of(self.own[known], self.points[known], self.noise).at(self.points[self.rows])


@dataclasses.dataclass(frozen=True, eq=False)
class SmoothSurface:
    """What a face does by a random field of the likeliest size and correlation length, from blocks of its points.

    Gaussian process regression (Rasmussen and Williams 2006, chapter 2 and section 5.4) with the Matern kernel 5/2.
    """

    middle: float
    blocks: list[IntArray]  # b of them: Rows of their points
    places: FloatArray  # (b, 3): Of the blocks
    medians: FloatArray  # (b,): Above the middle
    gains: FloatArray  # (b, b): Weight of the kernel about each by these
    length: float
    size: float  # Standard deviation of the field
    sigma: float  # Of the noise of a median

    @classmethod
    def of(cls, values: FloatArray, points: FloatArray, noise: float) -> SmoothSurface:
        """Of values at points, (n,), (n, 3), whose noise is above 0."""
        blocks = blocks_of(points)
        places = np.array([points[each].mean(axis=0) for each in blocks])
        medians = np.array([np.median(values[each]) for each in blocks])
        sigma = sigma_of(noise, len(blocks[0]))
        middle = float(medians.mean())
        best, chosen = -np.inf, (0.0, np.ones(len(medians)), np.eye(len(medians)), 1.0)
        for length, strengths, axes in _modes(places.tobytes()):
            square = (axes.T @ (medians - middle) / sigma) ** 2
            for size in SIZES_SIGMAS:
                spread = size**2 * strengths + 1.0
                height = -0.5 * float(np.sum(square / spread + np.log(spread)))
                if height > best:
                    best, chosen = height, (float(size), spread, axes, length)
        size, spread, axes, length = chosen
        gains = size**2 * (axes / spread) @ axes.T
        return cls(middle, blocks, places, medians - middle, gains, length, size * sigma, sigma)

    def at(self, places: FloatArray) -> FloatArray:
        """Its values, (m,), at places, (m, 3)."""
        return np.asarray(self.middle + self.kernel(places) @ (self.gains @ self.medians))

    def drawn(self, places: FloatArray, draws: int, rng: np.random.Generator) -> FloatArray:
        """Its values as they may be by its points, (draws, m), at places, (m, 3): between them it is not known."""
        own = matern(np.linalg.norm(places[:, None] - places[None], axis=2) / self.length)
        known = self.kernel(places)
        spread = self.size**2 * (own - known @ self.gains @ known.T) + self.sigma**2 / len(self.blocks)
        strengths, axes = np.linalg.eigh(spread)
        roots = np.sqrt(np.maximum(strengths, 0.0))
        return np.asarray(self.at(places) + rng.standard_normal((draws, len(places))) @ (axes * roots).T)

    def kernel(self, places: FloatArray) -> FloatArray:
        """Correlation of places with those of the blocks, (m, b)."""
        return matern(np.linalg.norm(places[:, None] - self.places[None], axis=2) / self.length)

    def means(self, values: FloatArray) -> FloatArray:
        """Of values of the points, (n,), in each block, (b,)."""
        sizes = np.array([len(each) for each in self.blocks])
        return np.asarray(np.add.reduceat(values[np.concatenate(self.blocks)], np.cumsum(sizes) - sizes) / sizes)


@functools.lru_cache(maxsize=KEPT_FACES)
def _modes(places: bytes) -> list[tuple[float, FloatArray, FloatArray]]:
    """Length, strengths and axes of the modes of fields at places, (b, 3): a face has several characteristics."""
    found = np.frombuffer(places).reshape(-1, 3)
    away = np.linalg.norm(found[:, None] - found[None], axis=2)
    extent = max(float(away.max()), np.finfo(float).tiny)
    modes = [(float(length), *np.linalg.eigh(matern(away / length))) for length in LENGTHS_EXTENTS * extent]
    return [(length, np.maximum(strengths, 0.0), axes) for length, strengths, axes in modes]


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
