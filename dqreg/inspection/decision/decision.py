"""Whether a part is within its tolerance: by places, by regions and over all, with the uncertainty of the pose."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.inspection.decision.coverage import scanned_share
from dqreg.inspection.decision.places import COVERAGE_FACTOR, OutOfTolerance, noise_of, places_of
from dqreg.inspection.decision.regions import Cut, Outcome, Region, cut_of, regions_of, require_faces
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.wall_doubts import WallDoubt
from dqreg.inspection.membership.membership import OFF_SIGMAS
from dqreg.inspection.tolerances import REQUIRED_SHARE, PointLimits, Tolerance, limits_at, require_share, tolerance_of

# Code of a decision on thin walls whose sides cannot be told apart.
WALL_SIDE, SOLVED_SCALE = "wall_side", "solved_scale"


@dataclasses.dataclass(frozen=True)
class Decision:
    """Whether the part is within its tolerance.

    Attributes
    ----------
    outcome : {"pass", "fail", "undecided"}
        The worst of the share, the regions and the places. Undecided where the tolerance lies within the uncertainty.
    tolerance : float
        Largest deviation allowed, target units; of several tolerances the largest.
    required_share : float
        Share of the points that must be within it, of all and of each region.
    share_within : float
        Share of the points on the part that are.
    share : {"pass", "fail", "undecided"}
        The decision on that share.
    uncertainty : float
        Of a deviation, from the pose, expanded (k = 2): the largest on the faces that were scanned, target units.
    places : tuple of OutOfTolerance
        Places that are not proven to be within the tolerance, the worst first; single points make none.
    regions : tuple of Region
        Scanned regions of the part with the outcome of each, the one with the most points first.
    regions_how : str
        How the part was cut into them.
    low, high : float
        Signed deviations allowed on faces without a tolerance of their own; infinite where they have none.
    own : int
        Faces with a tolerance of their own.
    scanned : float
        Share of the part's surface that scan points cover: of the rest nothing is decided. NaN where the target is a
        cloud, or has too many faces.
    wall_doubts : tuple of WallDoubt
        Patches of thin walls that may have been measured on their other side: with any of them nothing passes.
    codes : tuple of str
        Stable codes of what keeps a part from passing beside its deviations: ``"wall_side"`` for those patches,
        ``"solved_scale"`` where the scan was scaled to fit, so that its size was not measured.
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
    low: float = -math.inf
    high: float = math.inf
    own: int = 0
    scanned: float = math.nan
    wall_doubts: tuple[WallDoubt, ...] = ()
    codes: tuple[str, ...] = ()


def decide(
    deviations: Deviations,
    tolerance: float | Tolerance | None = None,
    required_share: float = REQUIRED_SHARE,
    faces: Mapping[int, float | Tolerance] | None = None,
) -> Decision:
    """Whether the part is within its tolerance.

    A place of the part is never forgiven, single points are: the part fails where the median of 25 neighbouring points
    is out of tolerance by more than its uncertainty, or where too few of the points, of all or of one region, are
    within by more than noise explains. It passes where the uncertainty of the pose cannot change that (ISO 14253-1).

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`.
    tolerance : float or Tolerance, optional
        Largest deviation allowed, target units, or the signed limits of unequal sides; default: that of ``deviations``.
    required_share : float
        Share of the points that must be within the tolerance, of all and of each region, above 0 and at most 1.
    faces : mapping of int to float or Tolerance, optional
        Tolerances of single faces, by their numbers (`part_faces`); each may have a required share of its own. Faces
        without one have ``tolerance``; without that too, nothing is asked of them.

    Returns
    -------
    Decision
        With the places and regions that decided it.

    Raises
    ------
    InputError
        If there is no tolerance, it is not below the reach (what deviates more was left out, so nothing could fail), it
        needs signs that the part does not have, or one of the numbers cannot be used.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, MeshSurface
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> top = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 3)) * [1, 1, 0] + [0, 0, 1]
    >>> top[np.linalg.norm(top[:, :2], axis=1) < 0.2, 2] += 0.03
    >>> found = measure_deviations(top, part, MeshSurface(part))
    >>> first = decide(found, tolerance=0.01)
    >>> first.outcome, round(first.share_within, 2), round(first.places[0].value, 3)
    ('fail', 0.98, 0.03)
    >>> decide(found, Tolerance(0.0 - 0.01, 0.04)).outcome
    'pass'
    """
    whole, own = _asked(deviations, tolerance, faces or {}, required_share)
    rows = np.flatnonzero(deviations.counted)
    values, room = deviations.values[rows], COVERAGE_FACTOR * deviations.pose_sigma(rows)
    cut = cut_of(deviations, by_face=bool(own))
    limits = limits_at(cut.labels, whole, own)
    places = places_of(deviations, rows, room, limits, cut.labels)
    noise = functools.cache(lambda: noise_of(deviations, rows, cut.labels))

    def of_region(region: Region) -> Region:
        at = cut.labels == region.number
        allowed = own.get(region.number, whole)
        if allowed is None:
            return region
        inner = limits.of(at)
        share = _by_share(values[at], room[at], lambda: noise()[at], inner, allowed.required_share or required_share)
        outcome = worst_of([share, *(place.outcome for place in places if place.region == region.number)])
        within = float(np.mean(inner.beyond(values[at]) <= 0.0))
        return dataclasses.replace(region, share_within=within, outcome=outcome, low=allowed.low, high=allowed.high)

    regions = tuple(of_region(region) for region in regions_of(deviations, cut))
    judged, uncertainty = limits.asked, _largest(room, limits.asked, cut, regions)
    values, room, limits = values[judged], room[judged], limits.of(judged)
    share = _by_share(values, room, lambda: noise()[judged], limits, required_share)
    outcomes = [share, *(place.outcome for place in places), *(region.outcome or "pass" for region in regions)]
    within = np.count_nonzero(limits.beyond(values) <= 0.0)
    return Decision(
        outcome=worst_of([*outcomes, "undecided" if _codes(deviations) else "pass"]),
        tolerance=max(each.size for each in (*own.values(), *([] if whole is None else [whole]))),
        required_share=required_share,
        share_within=float(within / len(values)) if len(values) else math.nan,
        share=share,
        uncertainty=uncertainty,
        places=places,
        regions=regions,
        regions_how=cut.how,
        low=-math.inf if whole is None else whole.low,
        high=math.inf if whole is None else whole.high,
        own=len(own),
        scanned=_scanned(deviations, cut),
        wall_doubts=deviations.wall_doubts,
        codes=_codes(deviations),
    )


def _largest(room: FloatArray, asked: BoolArray, cut: Cut, regions: tuple[Region, ...]) -> float:
    """Largest uncertainty: strays of faces that were not scanned say nothing of how well the others are held."""
    scanned = asked & np.isin(cut.labels, [region.number for region in regions])
    kept = room[scanned if scanned.any() else asked]
    return float(kept.max()) if len(kept) else math.nan


def _codes(deviations: Deviations) -> tuple[str, ...]:
    """Of what keeps a part from passing beside its deviations."""
    doubts = {WALL_SIDE: bool(deviations.wall_doubts), SOLVED_SCALE: deviations.scale_solved}
    return tuple(code for code, holds in doubts.items() if holds)


def _scanned(deviations: Deviations, cut: Cut) -> float:
    if cut.of_triangle is None:
        return math.nan
    assert isinstance(deviations.target, Mesh)
    points = deviations.points[deviations.counted] - deviations.origin
    return scanned_share(deviations.target, cut.of_triangle, points, cut.labels)


def _asked(
    deviations: Deviations,
    tolerance: float | Tolerance | None,
    faces: Mapping[int, float | Tolerance],
    required_share: float,
) -> tuple[Tolerance | None, dict[int, Tolerance]]:
    """The tolerance of the whole part and those of single faces, checked against what was measured."""
    require_share(required_share)
    given = deviations.tolerance if tolerance is None else tolerance
    whole = None if given is None else tolerance_of(given)
    own = {int(number): tolerance_of(each, f"the tolerance of face {number}") for number, each in faces.items()}
    if whole is None and not own:
        raise InputError("a decision needs a tolerance: the largest deviation allowed, in target units")
    if own:
        require_faces(deviations, list(own))
    for each in (*own.values(), *([] if whole is None else [whole])):
        require_held(deviations, each)
    return whole, own


def require_held(deviations: Deviations, tolerance: Tolerance) -> None:
    """Raise where deviations cannot be held against a tolerance: signs are missing, or what fails is left out."""
    if not deviations.signed and not tolerance.equal:
        raise InputError(f"unequal sides of a tolerance need signs: {deviations.reason}")
    # A reach that was found in the scan left out nothing of the part.
    farthest = max(deviations.reach, deviations.limit)
    if tolerance.size >= farthest:
        unit = f" {deviations.units}" if deviations.units else ""
        raise InputError(
            f"a tolerance of {tolerance.size:g}{unit} is not below the reach of {farthest:.4g}{unit}: points "
            "farther off were left out, so that nothing could fail; check the unit of the tolerance, or give a "
            "larger reach"
        )


def worst_of(outcomes: list[Outcome]) -> Outcome:
    """The worst of some outcomes.

    >>> worst_of(["pass", "undecided", "pass"])
    'undecided'
    """
    return "fail" if "fail" in outcomes else "undecided" if "undecided" in outcomes else "pass"


def _by_share(
    values: FloatArray, room: FloatArray, noise: Callable[[], FloatArray], limits: PointLimits, required: float
) -> Outcome:
    """Whether the required share of points is within: pass and fail are proven (ISO 14253-1).

    Of each point: deviation, what the pose adds (k = 2), and the standard deviation of its noise, which is
    only asked for where a share does not pass. Shapes: (n,).
    """
    count = len(values)
    if not count:
        return "undecided"
    # Pass where deviations larger by their uncertainty would do too, with all of their noise.
    if np.count_nonzero(limits.beyond(values) + room <= 0.0) >= required * count:
        return "pass"
    # Fail where smaller ones would not, nor any that noise could have moved from within.
    small = np.hypot(room, _noise_factor(required) * noise())
    return "fail" if np.count_nonzero(limits.beyond(values) <= small) < required * count else "undecided"


def _noise_factor(required: float) -> float:
    """By how many sigma noise may move points: those that hold that share, and one more for its long tails.

    >>> round(_noise_factor(0.95), 2), _noise_factor(1.0)
    (2.96, 6.0)
    """
    from scipy.special import ndtri

    return min(1.0 + float(ndtri(0.5 + 0.5 * required)), OFF_SIGMAS)


def decision_record(decision: Decision, origin: FloatArray) -> dict[str, Any]:
    """A decision as plain values, its regions' centres in the caller's frame as its places are; ``origin`` of it."""
    record = dataclasses.asdict(decision)
    for region in record["regions"]:
        region["centre"] = region["centre"] + origin
    return record
