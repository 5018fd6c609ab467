"""Statistics of deviations: percentiles, fractions within a tolerance, worst places, pass or fail."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError


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


# Numbers that are squared in one go.
CHUNK_VALUES = 1 << 16


def summary_of(
    values: FloatArray, total: int, tolerance: float | None = None, *, overwrite_input: bool = False
) -> Summary:
    """Figures of some deviations, which may be written over: of millions of points a copy would be what takes most.

    >>> found = summary_of(np.array([-1.0, 0.0, 3.0]), 4, tolerance=1.0)
    >>> found.beyond, found.p50, found.max, round(found.share_within, 3)
    (1, 1.0, 3.0, 0.667)
    """
    count = len(values)
    if not count:
        none = float("nan")
        return Summary(0, total, none, none, none, none, none, none, tolerance, None if tolerance is None else none)
    mean = float(values.mean())
    sizes = np.abs(values, out=values if overwrite_input else None)
    squares = sum(float(np.square(sizes[i : i + CHUNK_VALUES]).sum()) for i in range(0, count, CHUNK_VALUES))
    rms = float(np.sqrt(squares / count))
    largest = float(sizes.max())
    share = None if tolerance is None else float(np.count_nonzero(sizes <= tolerance) / count)
    p50, p95, p99 = (float(q) for q in np.quantile(sizes, [0.5, 0.95, 0.99], overwrite_input=True))
    return Summary(count, total - count, mean, rms, p50, p95, p99, largest, tolerance, share)


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


# Points that must deviate at least that much at a place, so that outliers make none ...
MIN_PLACE_POINTS = 5
# ... and at least this fraction of the points of its cell.
MIN_CELL_SHARE = 0.05
# Below that many points a touch probe measured, and every point is meant.
MIN_SCANNED_POINTS = 200
# A place holds the points that deviate at least that fraction of its own deviation.
SAME_PLACE_SHARE = 0.5


@dataclasses.dataclass(frozen=True)
class Place:
    """A patch that deviates.

    Attributes
    ----------
    value : float
        Deviation of the patch: the fifth largest there, or the value that a twentieth of the points of its cell
        reach, whichever is smaller in size; signed, target units.
    position : ndarray, (3,)
        The scan point that has this deviation, in the caller's target frame.
    points : int
        Points around it that deviate at least half as much to the same side.
    row : int
        Row of that point in the scan.
    """

    value: float
    position: FloatArray
    points: int
    row: int


def worst_places(feet: FloatArray, values: FloatArray, count: int, apart: float) -> list[Place]:
    """Largest deviations, at places that are apart.

    The target is cut into cells as wide as places are apart, one for either sign. A cell counts with the deviation that
    at least 5 of its points, and a twentieth of them, reach: four outliers in a cell change nothing, and neither do
    outliers all over the scan while they are fewer. Of two places nearer than ``apart`` the worse stays. Clouds of
    fewer than 200 points are probed by hand, and each of their points counts.
    """
    if not len(values) or count < 1:
        return []
    rows = _cell_rows(feet, values, apart)
    places: list[Place] = []
    for row in rows[np.argsort(-np.abs(values[rows]), kind="stable")]:
        if len(places) == count or values[row] == 0.0:
            break
        if all(math.dist(feet[row], place.position) >= apart for place in places):
            places.append(_place(feet, values, int(row), apart))
    return places


def _cell_rows(feet: FloatArray, values: FloatArray, apart: float) -> IntArray:
    """One row for each cell and sign: the point whose deviation the cell counts with."""
    fewest = MIN_PLACE_POINTS if len(values) >= MIN_SCANNED_POINTS else 1
    cells = np.floor((feet - feet.min(axis=0)) / apart).astype(np.int64)
    wide = cells.max(axis=0) + 1
    key = 2 * ((cells[:, 0] * wide[1] + cells[:, 1]) * wide[2] + cells[:, 2]) + (values > 0.0)
    order = np.lexsort((-np.abs(values), key))
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    sizes = np.diff(np.append(first, len(key)))
    # Points of the whole cell, whatever their sign.
    _, cell = np.unique(key[first] // 2, return_inverse=True)
    whole = np.bincount(cell, weights=sizes)[cell]
    rank = np.maximum(np.ceil(MIN_CELL_SHARE * whole).astype(np.int64) if fewest > 1 else 1, fewest)
    enough = sizes >= rank
    rows: IntArray = order[(first + rank - 1)[enough]]
    return rows


def _place(feet: FloatArray, values: FloatArray, row: int, apart: float) -> Place:
    value = float(values[row])
    alike = np.flatnonzero(values * math.copysign(1.0, value) >= SAME_PLACE_SHARE * abs(value))
    near = np.linalg.norm(feet[alike] - feet[row], axis=1) <= apart
    return Place(value, feet[row], int(np.count_nonzero(near)), row)


def require_length(value: float, name: str, or_infinite: bool = False) -> None:
    """Refuse what is no length above 0."""
    try:
        usable = 0.0 < float(value) < np.inf or (or_infinite and value == np.inf)
    except (TypeError, ValueError):
        usable = False
    if not usable or isinstance(value, (str, bool)):
        raise InputError(f"{name} must be a length above 0 in target units; got {value!r}")
