"""What values along lines may be without their noise: draws of a random field that explains them all."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.decision.surface_model import LENGTHS_EXTENTS, SIZES_SIGMAS, matern
from dqreg.inspection.features.spread import DRAW_SEED

FIELD_DRAWS = 400
# Of what noise adds to the zone of a mean, in what it adds to draws about it: half of its span from 0 to 2.
MEAN_NOISE_RATIO = 0.95
# No form error at all is possible where its likelihood is within that of the likeliest one, as a logarithm: two
# parameters at 95 %.
STRAIGHT_LOG_LIKELIHOOD = 3.0


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """Values along a line, each with the same noise."""

    places: FloatArray  # (n, 3): Neighbours along the line are neighbours here
    values: FloatArray  # (n,)
    slopes: FloatArray  # (n, k): What of the values is no form error: place, tilt, size
    sigma: float  # Standard deviation of a value


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """What several series may be."""

    values: tuple[FloatArray, ...]  # (draws, n) each, without what the slopes explain
    straight: bool  # Whether all may be without form error

    def measured(self, zones: FloatArray, mean: float, competing: float = MEAN_NOISE_RATIO) -> tuple[float, float]:
        """A value with its expanded uncertainty from a zone of each draw, (draws,), and that of their mean.

        By as much as draws are wider than their mean, noise widens extremes that compete; the mean itself holds noise
        that did so already: by nothing where its extremes stand alone, by up to twice as much where many are equal. Of
        the extremes of one field, which it smooths as well, none compete.
        """
        wider, scatter = float(zones.mean()) - mean, COVERAGE_FACTOR * float(zones.std())
        value = max(mean - competing * wider, 0.0)
        room = MEAN_NOISE_RATIO * wider + scatter
        if value == 0.0 or self.straight:
            # A form error that noise hides is as large as the draws are.
            room = max(room, mean + wider + scatter - value, value)
        return value, room


def drawn_series(series: Sequence[Series]) -> Drawn:
    """Draws of all series from the posterior of one random field of unknown size and correlation length.

    Gaussian process regression (Rasmussen and Williams 2006, sections 2.2, 2.7 and 5.4) with the Matern kernel 5/2;
    both parameters are drawn too, by their likelihood on all series.
    """
    extent = max(float(np.linalg.norm(np.ptp(each.places, axis=0))) for each in series)
    modes = [[_modes(each, length) for length in LENGTHS_EXTENTS * extent] for each in series]
    heights = np.zeros((len(LENGTHS_EXTENTS), len(SIZES_SIGMAS)))
    for own in modes:
        for k, (strengths, coefficients, _) in enumerate(own):
            spread = 1.0 + SIZES_SIGMAS[:, None] ** 2 * strengths
            heights[k] -= 0.5 * np.sum(coefficients**2 / spread + np.log(spread), axis=1)
    weights = np.exp(heights - heights.max()).ravel()
    rng = np.random.default_rng(DRAW_SEED)
    nodes = np.sort(rng.choice(weights.size, size=FIELD_DRAWS, p=weights / weights.sum()))
    found = tuple(_draws(own, each.sigma, nodes, rng) for own, each in zip(modes, series, strict=True))
    return Drawn(found, bool(heights[0, 0] > heights.max() - STRAIGHT_LOG_LIKELIHOOD))


Modes = tuple[FloatArray, FloatArray, FloatArray]


def _modes(series: Series, length: float) -> Modes:
    """Strength, coefficient in sigmas, and shape of the modes of a field beside the slopes: (m,), (m,), (n, m)."""
    count = series.slopes.shape[1]
    beside = np.linalg.qr(series.slopes, mode="complete")[0][:, count:]
    away = np.linalg.norm(series.places[:, None] - series.places[None], axis=2)
    strengths, axes = np.linalg.eigh(beside.T @ matern(away / length) @ beside)
    shapes = beside @ axes
    return np.maximum(strengths, 0.0), shapes.T @ series.values / series.sigma, shapes


def _draws(modes: Sequence[Modes], sigma: float, nodes: np.ndarray, rng: np.random.Generator) -> FloatArray:
    found = []
    for node, repeats in zip(*np.unique(nodes, return_counts=True), strict=True):
        strengths, coefficients, shapes = modes[node // len(SIZES_SIGMAS)]
        share = SIZES_SIGMAS[node % len(SIZES_SIGMAS)] ** 2 * strengths
        share = share / (1.0 + share)
        noise = rng.standard_normal((repeats, len(share)))
        found.append(sigma * (share * coefficients + np.sqrt(share) * noise) @ shapes.T)
    return np.concatenate(found)
