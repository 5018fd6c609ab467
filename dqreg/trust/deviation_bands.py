"""Figures of many deviations: percentiles, shares within a tolerance, pass or fail."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray


@dataclasses.dataclass(frozen=True)
class Summary:
    """Figures of deviations, target units; NaN where no point counts.

    Attributes
    ----------
    count : int
        Points that count: those within reach of the target.
    beyond : int
        Points farther off, which do not.
    mean, rms : float
        Mean (signed where signs are known) and root mean square.
    p50, p95, p99, max : float
        Percentiles and maximum of the absolute deviation.
    tolerance : float or None
        What was allowed.
    share_within : float or None
        Share of the points within the tolerance; None where none was given.
    """

    count: int
    beyond: int
    mean: float
    rms: float
    p50: float
    p95: float
    p99: float
    max: float
    tolerance: float | None = None
    share_within: float | None = None


@dataclasses.dataclass(frozen=True)
class Band:
    """Points whose deviation lies between two limits, both inclusive for the middle band.

    Attributes
    ----------
    low, high : float
        Limits, target units; infinite at the ends.
    count : int
        Points in it.
    share : float
        Of all points that count; NaN where there are none.
    """

    low: float
    high: float
    count: int
    share: float


@dataclasses.dataclass(frozen=True)
class Bands:
    """The table of bands and its verdict.

    Attributes
    ----------
    tolerance : float
        T, target units.
    rows : tuple of Band
        From the lowest to the highest.
    within, below, above : float
        Shares within -T..T, below -T and above T.
    required_share : float
        What must be within to pass.
    passed : bool
        Whether it is.
    """

    tolerance: float
    rows: tuple[Band, ...]
    within: float
    below: float
    above: float
    required_share: float
    passed: bool


def summary_of(values: FloatArray, total: int, tolerance: float | None = None) -> Summary:
    """Figures of some deviations.

    >>> found = summary_of(np.array([-1.0, 0.0, 3.0]), 4, tolerance=1.0)
    >>> found.beyond, found.p50, found.max, round(found.share_within, 3)
    (1, 1.0, 3.0, 0.667)
    """
    count = len(values)
    if not count:
        none = float("nan")
        return Summary(0, total, none, none, none, none, none, none, tolerance, None if tolerance is None else none)
    sizes = np.abs(values)
    p50, p95, p99 = (float(q) for q in np.quantile(sizes, [0.5, 0.95, 0.99]))
    share = None if tolerance is None else float(np.count_nonzero(sizes <= tolerance) / count)
    rms = float(np.sqrt(np.mean(values**2)))
    return Summary(count, total - count, float(values.mean()), rms, p50, p95, p99, float(sizes.max()), tolerance, share)


def bands_of(values: FloatArray, tolerance: float, required_share: float, signed: bool) -> Bands:
    """Table of bands."""
    half, count = 0.5 * tolerance, len(values)
    sizes = np.abs(values)
    ring = (sizes > half).astype(np.int64) + (sizes > tolerance)
    limits = [(half, tolerance), (tolerance, np.inf)]
    if signed:
        place = np.where(values < 0.0, 2 - ring, 2 + ring)
        ends = [*((-high, -low) for low, high in reversed(limits)), (-half, half), *limits]
    else:
        place, ends = ring, [(0.0, half), *limits]
    counts = np.bincount(place, minlength=len(ends))
    shares = counts / count if count else np.full(len(ends), np.nan)
    rows = tuple(
        Band(float(low), float(high), int(n), float(share))
        for (low, high), n, share in zip(ends, counts, shares, strict=True)
    )
    within = float(np.count_nonzero(sizes <= tolerance) / count) if count else float("nan")
    below = rows[0].share if signed else 0.0
    return Bands(tolerance, rows, within, below, rows[-1].share, required_share, within >= required_share)
