"""Edge points: where two fitted planes meet, or where a sheet ends, in the section across the nominal edge."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError
from dqreg.inspection.features.feature import NUDGE_SIGMAS, Feature

EdgeKind = Literal["meeting", "border"]

# Faces that turn by less than the sine of it (10 degrees) do not meet in an edge.
MIN_EDGE_SIN = 0.17
# Width of a strip across a border, and strips that show where one is.
STRIP_WIDTH_SPACINGS, MIN_STRIPS = 2.0, 5
# Imaginary borders inside the sheet, from and to that share of the depth: how the estimate does is seen there.
TRIAL_BORDER_SHARES, TRIAL_BORDERS = (0.1, 0.8), 40


@dataclasses.dataclass(frozen=True, eq=False)
class EdgePoint:
    """A point of an edge, in the section across the nominal edge.

    Attributes
    ----------
    kind : {"meeting", "border"}
        Where two faces meet, or where an open sheet ends.
    point, nominal : ndarray, (3,)
        Measured, and on the part itself.
    direction : ndarray, (3,)
        Of the nominal edge: along it the point is not measured.
    outward : ndarray, (3,)
        Within the first face, across its edge, away from its material.
    covariance : ndarray, (3, 3)
        Of ``point``; 0 along ``direction``.
    points : int
        Scan points that it rests on.
    faces : tuple of int
        Its faces, the first first; one for a border.
    """

    kind: EdgeKind
    point: FloatArray
    nominal: FloatArray
    direction: FloatArray
    outward: FloatArray
    covariance: FloatArray
    points: int
    faces: tuple[int, ...]

    @property
    def offset(self) -> float:
        """How far the edge lies beyond the nominal one, along ``outward``: positive where there is more material."""
        return float((self.point - self.nominal) @ self.outward)

    @property
    def sigma(self) -> float:
        """Standard deviation of ``offset``."""
        return float(np.sqrt(max(float(self.outward @ self.covariance @ self.outward), 0.0)))


def meeting_point(
    first: Feature, second: Feature, nominal: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where two planes meet in the section through a point across a direction, and its covariance: (3,), (3, 3)."""
    if np.linalg.norm(np.cross(first.axis, second.axis)) < MIN_EDGE_SIN:
        raise DegenerateGeometryError("the faces meet at too small an angle for an edge: they run into each other")
    found = _met(first, second, nominal, direction)
    total = np.zeros((3, 3))
    for k, plane in enumerate((first, second)):
        variances, vectors = np.linalg.eigh(plane.covariance)
        for step in (vectors * np.sqrt(np.maximum(variances, 0.0))).T:
            moved = plane.nudged(NUDGE_SIGMAS * step)
            pair = (moved, second) if k == 0 else (first, moved)
            change = (_met(*pair, nominal, direction) - found) / NUDGE_SIGMAS
            total += np.outer(change, change)
    return found, total


def _met(first: Feature, second: Feature, nominal: FloatArray, direction: FloatArray) -> FloatArray:
    rows = np.stack([first.axis, second.axis, direction])
    away = [first.axis @ (first.point - nominal), second.axis @ (second.point - nominal), 0.0]
    met: FloatArray = nominal + np.linalg.solve(rows, np.array(away))
    return met


def border_offset(along: FloatArray, outward: FloatArray, spacing: float) -> tuple[float, float]:
    """Where points end: their least squares border at ``along`` 0, and its standard deviation. Shapes: (n,), (n,).

    In each strip the outermost point lies short of the border by less than the points' distance. By how much on
    average, and how far one estimate is off, is seen at imaginary borders inside the sheet, whatever their pattern is.
    """
    width = STRIP_WIDTH_SPACINGS * spacing
    half = float(np.abs(along).max(initial=0.0))
    count = int(2.0 * half / width)
    if count < MIN_STRIPS:
        raise DegenerateGeometryError(f"{len(along)} points do not show where a border is: scan it more densely")
    strip = np.clip(((along + half) / (2.0 * half) * count).astype(np.int64), 0, count - 1)
    middles = ((np.arange(count) + 0.5) / count * 2.0 - 1.0) * half
    found, slope = _line(middles, _outermost(strip, outward, count, np.inf))
    straight = outward - slope * along
    depth = found - float(straight.min())
    cuts = found - depth * np.linspace(*TRIAL_BORDER_SHARES, TRIAL_BORDERS)
    short = np.array([cut - _outermost(strip, straight, count, cut) for cut in cuts])
    missed = np.array([_line(middles, row)[0] for row in short])
    if not np.isfinite(found) or not np.isfinite(missed).all():
        raise DegenerateGeometryError(f"{len(along)} points do not show where a border is: scan it more densely")
    # Strips of random points scatter by themselves; rows of points along the border are all short by the same.
    alone = float(np.nanvar(short, axis=1, ddof=2).mean()) / count
    between = float(missed.var(ddof=1))
    layers = max(float(np.ptp(cuts)) / max(float(np.nanmean(short)), np.finfo(float).tiny), 1.0)
    return found + float(missed.mean()), float(np.sqrt(max(alone, between) * (1.0 + 1.0 / layers)))


def _outermost(strip: IntArray, outward: FloatArray, count: int, cut: float) -> FloatArray:
    """The outermost point below a cut in each strip; NaN where there is none."""
    most = np.full(count, -np.inf)
    below = outward <= cut
    np.maximum.at(most, strip[below], outward[below])
    return np.where(np.isfinite(most), most, np.nan)


def _line(at: FloatArray, values: FloatArray) -> tuple[float, float]:
    known = np.isfinite(values)
    if np.count_nonzero(known) < MIN_STRIPS:
        return float("nan"), 0.0
    slope, height = np.polyfit(at[known], values[known], 1)
    return float(height), float(slope)
