"""The decision on the deviations as measured values: the same rows in the table of one part and in those of a batch."""

from __future__ import annotations

import dataclasses
import math

from dqreg.inspection import Decision, OutOfTolerance, Region
from dqreg.report.text import percent, text_of

SCALE_WORDS = "The scan was scaled to fit, so the size of the part was not measured (solved_scale)."
OUTCOME_SIGNS = {"pass": "✓", "undecided": "?", "fail": "✗"}


@dataclasses.dataclass(frozen=True)
class DecisionRow:
    """One value that a decision rests on."""

    name: str
    kind: str  # "share" in percent, "deviation" in target units
    nominal: float
    # low, high: NaN or infinite where there is no such limit
    low: float
    high: float
    value: float
    uncertainty: float
    outcome: str  # "" where nothing is asked
    points: int | None
    remark: str = ""
    cause: Cause | None = None  # What decided in place of the value


@dataclasses.dataclass(frozen=True)
class Cause:
    """What decides a region that its median does not: the share of its points, in percent, or a place of it."""

    name: str  # "share" or "place"
    value: float
    low: float
    high: float


def decision_rows(found: Decision) -> list[DecisionRow]:
    """The share within the tolerance, then the median deviation of each region."""
    of_all = DecisionRow(
        "points within the tolerance",
        "share",
        100.0,
        100.0 * found.required_share,
        math.nan,
        100.0 * found.share_within,
        math.nan,
        found.share,
        None,
        wall_words(found),
    )
    return [of_all, *(_of_region(found, region) for region in sorted(found.regions, key=lambda each: each.number))]


def _of_region(found: Decision, region: Region) -> DecisionRow:
    name = f"face {region.number}, {region.name}: median deviation"
    numbers = (0.0, region.low, region.high, region.median, found.uncertainty)
    cause = _cause(found, region)
    remark = "" if cause is None else _remark(found, region)
    return DecisionRow(name, "deviation", *numbers, region.outcome or "", region.points, remark, cause)


def wall_words(found: Decision, of: str = "") -> str:
    """Why nothing passes where the sides of a thin wall cannot be told apart, and what to do; "" where they can."""
    if not found.wall_doubts:
        return ""
    first, count = found.wall_doubts[0], len(found.wall_doubts)
    many = "a patch" if count == 1 else f"{count} patches"
    where = ", ".join(text_of(x) for x in first.position).replace("−", "-")
    return (
        f"{many} of a wall {text_of(first.thickness)}{of} thick, at ({where}){of}, may be the scanned side dented by "
        "more than half of that, or the other side: give --viewpoint, or a scan with oriented normals"
    )


def shown_outcome(outcome: str, *, trusted: bool) -> dict[str, str]:
    """Class, sign and words of an outcome: a pass on an alignment that is not trusted must not look like one.

    >>> shown_outcome("pass", trusted=True)["said"], shown_outcome("pass", trusted=False)["said"]
    ('pass', 'pass, if the alignment holds')
    """
    if outcome == "pass" and not trusted:
        return {"kind": "conditional", "sign": "?", "said": "pass, if the alignment holds"}
    return {"kind": outcome, "sign": OUTCOME_SIGNS.get(outcome, ""), "said": outcome}


def _cause(found: Decision, region: Region) -> Cause | None:
    """What keeps a region from passing; None where it passes."""
    if region.outcome in ("pass", None):
        return None
    worst = _worst_place(found, region)
    if worst is not None:
        return Cause("place", worst.value, region.low, region.high)
    # A face may have a required share of its own.
    required = math.nan if found.own else 100.0 * found.required_share
    return Cause("share", 100.0 * (region.share_within or 0.0), required, math.nan)


def _worst_place(found: Decision, region: Region) -> OutOfTolerance | None:
    own = [place for place in found.places if place.region == region.number and place.outcome == region.outcome]
    # The worst is the first.
    return own[0] if own else None


def _remark(found: Decision, region: Region) -> str:
    """Why a region does not pass, which its median does not say: its places, or the share of its points."""
    worst = _worst_place(found, region)
    if worst is not None:
        value, room = text_of(worst.value), text_of(worst.uncertainty, 2)
        return f"a place of it deviates by {value} ± {room}".replace("−", "-")
    return f"{percent(region.share_within or 0.0)} % of its points are within the tolerance"
