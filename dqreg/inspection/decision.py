"""Whether a part is within its tolerance: by places, by regions and over all, with the uncertainty of the pose."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.regions import Cut, Outcome, Region, cut_of, regions_of
from dqreg.inspection.statistics import PROBED
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# Share of the points that must be within the tolerance, of the scan and of each region, unless another one is asked.
REQUIRED_SHARE = 0.95
# Expanded uncertainty, in standard deviations: 95 % (ISO 14253-1, k = 2).
COVERAGE = 2.0
# A place is the median of so many neighbouring points: half of them may be noise.
PLACE = 25
# Places that are named.
NAMED = 50
# Points asked whether a place is out of tolerance, and points that answer for the neighbourhood: more say the same.
ASKED, NEIGHBOURS = 20_000, 1_000_000
# Standard deviation of a median of n normal values: 1.2533 sigma / sqrt(n).
MEDIAN_SIGMA = 1.2533


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


@dataclasses.dataclass(frozen=True)
class Decision:
    """Whether the part is within its tolerance.

    Attributes
    ----------
    outcome : {"pass", "fail", "undecided"}
        The worst of the share, the regions and the places. Undecided where the tolerance lies within the uncertainty.
    tolerance : float
        Largest deviation allowed, target units.
    required_share : float
        Share of the points that must be within it, of all and of each region.
    share_within : float
        Share of the points on the part that are.
    share : {"pass", "fail", "undecided"}
        The decision on that share.
    uncertainty : float
        Of a deviation, from the pose, expanded (k = 2): the largest on the part, target units.
    places : tuple of OutOfTolerance
        Places that are not proven to be within the tolerance, the worst first; single points make none.
    regions : tuple of Region
        Scanned regions of the part with the outcome of each, the one with the most points first.
    regions_how : str
        How the part was cut into them.
    """

    outcome: Outcome
    tolerance: float
    required_share: float
    share_within: float
    share: Outcome
    uncertainty: float
    places: tuple[OutOfTolerance, ...]
    regions: tuple[Region, ...]
    regions_how: str


def decide(deviations: Deviations, tolerance: float | None = None, required_share: float = REQUIRED_SHARE) -> Decision:
    """Whether the part is within its tolerance.

    A place of the part is never forgiven, single points are: the part fails where the median of 25 neighbouring points
    is out of tolerance by more than its uncertainty, or where too few of the points, of all or of one region, are
    within. It passes where the uncertainty of the pose cannot change that (ISO 14253-1).

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`.
    tolerance : float, optional
        Largest deviation allowed, target units; default: that of ``deviations``.
    required_share : float
        Share of the points that must be within the tolerance, of all and of each region, above 0 and at most 1.

    Returns
    -------
    Decision
        With the places and regions that decided it.

    Raises
    ------
    InputError
        If there is no tolerance, or one of the numbers cannot be used.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, MeshSurface
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> top = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 3)) * [1, 1, 0] + [0, 0, 1]
    >>> top[np.linalg.norm(top[:, :2], axis=1) < 0.2, 2] += 0.03
    >>> found = decide(measure_deviations(top, part, MeshSurface(part)), tolerance=0.01)
    >>> found.outcome, round(found.share_within, 2), round(found.places[0].value, 3)
    ('fail', 0.98, 0.03)
    """
    allowed = deviations.summary(tolerance).tolerance
    if allowed is None:
        raise InputError("a decision needs a tolerance: the largest deviation allowed, in target units")
    if not 0.0 < required_share <= 1.0:
        raise InputError(f"required_share must be above 0 and at most 1; got {required_share!r}")
    rows = np.flatnonzero(deviations.counted)
    sizes, room = np.abs(deviations.values[rows]), COVERAGE * deviations.pose_sigma(rows)
    cut = cut_of(deviations)
    places = _places(deviations, rows, room, allowed, cut)

    def of_region(region: Region) -> Region:
        own = cut.labels == region.number
        share = _by_share(sizes[own], room[own], allowed, required_share)
        outcome = worst_of([share, *(place.outcome for place in places if place.region == region.number)])
        within = float(np.count_nonzero(sizes[own] <= allowed) / max(region.points, 1))
        return dataclasses.replace(region, share_within=within, outcome=outcome)

    regions = tuple(of_region(region) for region in regions_of(deviations, cut))
    share = _by_share(sizes, room, allowed, required_share)
    outcomes = [share, *(place.outcome for place in places), *(region.outcome or "pass" for region in regions)]
    return Decision(
        outcome=worst_of(outcomes),
        tolerance=allowed,
        required_share=required_share,
        share_within=float(np.count_nonzero(sizes <= allowed) / len(sizes)) if len(sizes) else math.nan,
        share=share,
        uncertainty=float(room.max()) if len(room) else math.nan,
        places=places,
        regions=regions,
        regions_how=cut.how,
    )


def worst_of(outcomes: list[Outcome]) -> Outcome:
    """The worst of some outcomes.

    >>> worst_of(["pass", "undecided", "pass"])
    'undecided'
    """
    return "fail" if "fail" in outcomes else "undecided" if "undecided" in outcomes else "pass"


def _by_share(sizes: FloatArray, room: FloatArray, tolerance: float, required: float) -> Outcome:
    # Pass where deviations larger by their uncertainty would do too, fail where smaller ones would not.
    if not len(sizes):
        return "undecided"
    if np.count_nonzero(sizes + room <= tolerance) >= required * len(sizes):
        return "pass"
    return "fail" if np.count_nonzero(sizes - room <= tolerance) < required * len(sizes) else "undecided"


def _places(
    deviations: Deviations, rows: IntArray, room: FloatArray, tolerance: float, cut: Cut
) -> tuple[OutOfTolerance, ...]:
    asked = np.flatnonzero(np.abs(deviations.values[rows]) + room > tolerance)
    asked = asked[:: -(-max(len(asked), 1) // ASKED)]
    if not len(asked):
        return ()
    medians, spreads = _medians(deviations, rows, asked)
    uncertainty = np.hypot(room[asked], COVERAGE * spreads)
    fails = np.abs(medians) - uncertainty > tolerance
    near = fails | (np.abs(medians) + uncertainty > tolerance)
    feet = deviations.closest[rows[asked]] - deviations.origin
    # Those that fail first, the largest first.
    order = np.lexsort((-np.abs(medians), ~fails))
    return tuple(
        OutOfTolerance(
            value=float(medians[k]),
            uncertainty=float(uncertainty[k]),
            position=deviations.points[rows[asked[k]]],
            outcome="fail" if fails[k] else "undecided",
            region=int(cut.labels[asked[k]]),
        )
        for k in _apart(feet, order[near[order]], deviations.apart)
    )


def _medians(deviations: Deviations, rows: IntArray, asked: IntArray) -> tuple[FloatArray, FloatArray]:
    """Median deviation about each asked point, and its standard deviation. Shapes: (m,), (m,)."""
    values = deviations.values[rows]
    if len(rows) < PROBED:
        return values[asked], np.zeros(len(asked))
    from scipy.spatial import cKDTree

    # Neighbours on the part: a point off it stands with those that were measured where it should be.
    step = -(-len(rows) // NEIGHBOURS)
    feet = deviations.closest[rows] - deviations.origin
    _, beside = cKDTree(feet[::step]).query(feet[asked], k=PLACE)
    around = values[::step][beside]
    medians = np.median(around, axis=1)
    spreads = GAUSSIAN_MEDIAN * np.median(np.abs(around - medians[:, None]), axis=1)
    return medians, MEDIAN_SIGMA * spreads / math.sqrt(PLACE)


def _apart(feet: FloatArray, order: IntArray, apart: float) -> list[int]:
    """The first of the order, and each further one that is not near one taken."""
    taken: list[int] = []
    left: BoolArray = np.ones(len(order), dtype=bool)
    while left.any() and len(taken) < NAMED:
        first = int(order[np.argmax(left)])
        taken.append(first)
        left &= np.linalg.norm(feet[order] - feet[first], axis=1) >= max(apart, 1e-300)
    return taken
