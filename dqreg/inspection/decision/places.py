"""Places of a part that are not proven to be within the tolerance: medians of neighbouring points."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.membership.membership import OFF_SIGMAS
from dqreg.inspection.statistics import MIN_SCANNED_POINTS
from dqreg.inspection.tolerances import PointLimits
from dqreg.solvers.robust import GAUSSIAN_MEDIAN, scatter_of

# Expanded uncertainty, in standard deviations: 95 % (ISO 14253-1, k = 2).
COVERAGE_FACTOR = 2.0
# A place is the median of so many neighbouring points: half of them may be noise.
PLACE_POINTS = 25
# Places that are named.
MAX_NAMED_PLACES = 50
# Points asked whether a place is out of tolerance, and points that answer for the neighbourhood: more say the same.
MAX_ASKED_POINTS, MAX_NEIGHBOUR_POINTS = 20_000, 1_000_000
# Standard deviation of a median of n normal values: 1.2533 sigma / sqrt(n).
MEDIAN_SIGMA = 1.2533
# Neighbours that lie farther apart than usual by this factor are strays; so many points say what is usual.
SPARSE_RATIO, SPACING_SAMPLE = 3.0, 1_000
# The same on one side of a thin wall: what is farther apart there is no scan of it.
SPARSE_SIDE_RATIO = 4.0


@dataclasses.dataclass(frozen=True)
class OutOfTolerance:
    """A place of the part that is not proven to be within the tolerance.

    Attributes
    ----------
    value : float
        Median deviation of the 25 neighbouring points there, signed where signs are known, target units.
    uncertainty : float
        Of that value, expanded (k = 2): of the pose and of the median.
    position : ndarray, (3,)
        In the caller's target frame.
    outcome : {"fail", "undecided"}
        Undecided where the tolerance lies within the uncertainty.
    region : int
        Number of its region.
    """

    value: float
    uncertainty: float
    position: FloatArray
    outcome: Outcome
    region: int


def places_of(
    deviations: Deviations, rows: IntArray, room: FloatArray, limits: PointLimits, labels: IntArray
) -> tuple[OutOfTolerance, ...]:
    """Places that are not proven to be within, those that fail first, then the farthest out.

    Of the counted points, ``rows`` of the scan: expanded uncertainty, limits and region of each.
    """
    asked = np.flatnonzero(limits.beyond(deviations.values[rows]) + room > 0.0)
    asked = asked[:: -(-max(len(asked), 1) // MAX_ASKED_POINTS)]
    if not len(asked):
        return ()
    medians, spreads, rooms = _medians(deviations, rows, asked, room)
    uncertainty = np.hypot(rooms, COVERAGE_FACTOR * spreads)
    beyond = limits.of(asked).beyond(medians)
    fails = beyond > uncertainty
    near = fails | (beyond + uncertainty > 0.0)
    feet = deviations.closest[rows[asked]] - deviations.origin
    order = np.lexsort((-beyond, ~fails))
    return tuple(
        OutOfTolerance(
            value=float(medians[k]),
            uncertainty=float(uncertainty[k]),
            position=deviations.points[rows[asked[k]]],
            outcome="fail" if fails[k] else "undecided",
            region=int(labels[asked[k]]),
        )
        for k in _apart(feet, order[near[order]], deviations.apart)
    )


def noise_of(deviations: Deviations, rows: IntArray, labels: IntArray) -> FloatArray:
    """Standard deviation of each point's noise: of its region's neighbours among each other. Shapes: (m,) each."""
    noise = np.full(len(rows), 0.0 if len(rows) < MIN_SCANNED_POINTS else deviations.noise or 0.0)
    if len(rows) < MIN_SCANNED_POINTS:
        return noise
    feet, values = deviations.closest[rows] - deviations.origin, deviations.values[rows]
    order = np.argsort(labels, kind="stable")
    for own in np.split(order, 1 + np.flatnonzero(np.diff(labels[order]))):
        if len(own) > PLACE_POINTS:
            kept = own[:: -(-len(own) // MAX_ASKED_POINTS)]
            around = _beside(feet[kept], feet[kept[:: -(-len(kept) // SPACING_SAMPLE)]])[0]
            noise[own] = float(np.median(_voted(values[kept][around])[1]))
    return noise


def _medians(
    deviations: Deviations, rows: IntArray, asked: IntArray, room: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Median deviation about each asked point, its standard deviation, and what the pose adds. Shapes: (m,) each."""
    values = deviations.values[rows]
    if len(rows) < MIN_SCANNED_POINTS:
        return values[asked], np.zeros(len(asked)), room[asked]
    step = -(-len(rows) // MAX_NEIGHBOUR_POINTS)
    feet, kept = deviations.closest[rows] - deviations.origin, values[::step]
    # Neighbours on the part: a point off it stands with those that were measured where it should be.
    around = _on_one_side(deviations, rows[::step], feet[::step], rows[asked], feet[asked])
    medians, spreads = _voted(kept[around])
    # A stray that is nearest to a face which was not scanned, beyond an edge, has neighbours that are held better.
    rooms = np.median(room[::step][around], axis=1)
    # Far off a part it stands with those that were measured beside it as well: what closes a hole has its feet along
    # the rim, where good points have theirs too. Nearer, those beside a point that noise has raised are raised as well.
    sigma = deviations.noise or scatter_of(values)
    far = np.flatnonzero(np.abs(values[asked]) > OFF_SIGMAS * sigma)
    if len(far):
        points = (deviations.points[rows] - deviations.origin)[::step]
        beside, widths = _beside(points, deviations.points[rows[asked[far]]] - deviations.origin)
        others, scatters = _voted(kept[beside])
        usual = float(np.median(_beside(points, points[:: -(-len(points) // SPACING_SAMPLE)])[1]))
        # Fewer points in the same place are strays. The vote that deviates more counts.
        more = (widths <= SPARSE_RATIO * usual) & (np.abs(others) > np.abs(medians[far]))
        medians[far[more]], spreads[far[more]], rooms[far[more]] = others[more], scatters[more], room[asked[far[more]]]
    return medians, MEDIAN_SIGMA * spreads / math.sqrt(PLACE_POINTS), rooms


def _on_one_side(deviations: Deviations, rows: IntArray, feet: FloatArray, of: IntArray, asked: FloatArray) -> IntArray:
    """The points nearest to each asked one on its side of a thin wall, (m, 25): there may be many more on the other.

    Feet of some rows of the scan, (n, 3), and of those asked, (m, 3).
    """
    beside, widths = _beside(feet, asked)
    normals, own = deviations.normals(rows), deviations.normals(of)
    mixed = np.flatnonzero((np.einsum("ijk,ik->ij", normals[beside], own) < 0.0).any(axis=1))
    if len(mixed):
        # As far apart as the part is large.
        sided = np.hstack([feet, deviations.size * normals])
        found, reach = _beside(sided, np.hstack([asked[mixed], deviations.size * own[mixed]]))
        # Few strays say nothing of a place, that their scatter would leave open.
        medians, spreads = _voted(deviations.values[rows][found])
        told = np.abs(medians) > COVERAGE_FACTOR * MEDIAN_SIGMA * spreads / math.sqrt(PLACE_POINTS)
        told &= reach <= SPARSE_SIDE_RATIO * widths[mixed]
        beside[mixed[told]] = found[told]
    return beside


def _beside(points: FloatArray, asked: FloatArray) -> tuple[IntArray, FloatArray]:
    """The points nearest to each asked one, (m, 25), and how far the last of them lies, (m,)."""
    from scipy.spatial import cKDTree

    away, beside = cKDTree(points).query(asked, k=PLACE_POINTS)
    return np.asarray(beside), np.asarray(away)[:, -1]


def _voted(around: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median of each row and its scatter."""
    medians = np.median(around, axis=1)
    return medians, GAUSSIAN_MEDIAN * np.median(np.abs(around - medians[:, None]), axis=1)


def _apart(feet: FloatArray, order: IntArray, apart: float) -> list[int]:
    """The first of the order, and each further one that is not near one taken."""
    taken: list[int] = []
    left: BoolArray = np.ones(len(order), dtype=bool)
    while left.any() and len(taken) < MAX_NAMED_PLACES:
        first = int(order[np.argmax(left)])
        taken.append(first)
        left &= np.linalg.norm(feet[order] - feet[first], axis=1) >= max(apart, 1e-300)
    return taken
