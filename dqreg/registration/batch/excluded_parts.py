"""Parts that a trend leaves out, and whether their shape may be why: then the rest says nothing of the lot."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dqreg.trust.code_sets import OF_HOW_IT_WAS_SCANNED

if TYPE_CHECKING:
    from dqreg.registration.batch.line import Line


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """A part that was to be measured, and whose value no trend may be made of."""

    name: str  # Of the part
    link: str  # Path of its page, from the summary
    before: int  # Values of the trend that stand before it in the manifest
    verdict: str  # As `Line` has it
    codes: tuple[str, ...]  # Of the verdict's reasons
    reason: str  # Why, as a sentence
    value: float  # Measured under a pose that is not trusted; NaN where there is none
    outcome: str  # Of that; "" where there is none

    @property
    def may_be_its_shape(self) -> bool:
        """Whether it may be a reject: its shape may be the doubt, or it measures out of its limits.

        One without a pose says nothing either way.
        """
        if self.outcome == "fail" or self.verdict == "accepted":
            return True
        return self.verdict == "suspect" and not (self.codes and OF_HOW_IT_WAS_SCANNED.issuperset(self.codes))

    @property
    def words(self) -> str:
        """The same for a cell or a list."""
        why = [self.verdict, *dict.fromkeys(filter(None, self.codes))] if self.verdict != "accepted" else [self.reason]
        measured = [f"{self.value:.6g} ({self.outcome})"] if math.isfinite(self.value) else []
        return f"{self.name}: " + ", ".join([*why, *measured])


def left_out_of(line: Line, before: int, value: Mapping[str, Any] | None) -> LeftOut:
    """What is left out of a trend with a line; the value that was measured, None where there is none."""
    error = "" if line.inspection is None else str(line.inspection.get("error") or "")
    if not error and not math.isnan(line.scale):
        error = f"scaled by {line.scale:.6g} to fit, so that its size was not measured"
    reason = error if line.verdict == "accepted" else next(iter(line.reasons), error)
    measured = None if value is None else value["value"]
    return LeftOut(
        line.row.shown,
        line.link if line.ran else "",
        before,
        line.verdict,
        tuple(getattr(reason, "code", "") for reason in line.reasons),
        reason,
        math.nan if measured is None else float(measured),
        "" if value is None or measured is None else str(value["outcome"]),
    )


def withheld_words(left_out: Sequence[LeftOut], parts: int) -> str:
    """Why a trend says nothing of the lot; "" where it does.

    >>> withheld_words([], 3)
    ''
    """
    doubted = [each.name for each in left_out if each.may_be_its_shape]
    if not doubted:
        return ""
    return (
        f"no Cp, Cpk and control limits: {len(doubted)} of {parts} parts are left out that may be rejects, as their "
        "shape may be why their alignment is not trusted, their size was not measured, or they are out of their limits"
    )
