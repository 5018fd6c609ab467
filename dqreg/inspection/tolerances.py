"""Tolerances of deviations: equal or unequal sides, one for the whole part or one for each face."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._numbers import is_number
from dqreg.errors import InputError
from dqreg.inspection.statistics import require_length

# Share of the points that must be within the tolerance, of the scan and of each region, unless another one is asked.
REQUIRED_SHARE = 0.95
NUMBER = r"(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)"
SIDES = re.compile(rf"([-+]?){NUMBER}\s*/\s*([-+]?){NUMBER}")
BOTH = re.compile(rf"(?:±|\+/?-)\s*{NUMBER}")


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """Deviations that are allowed, target units; positive outside the part.

    Attributes
    ----------
    low, high : float
        Smallest and largest signed deviation allowed: -0.05 and 0.1 for +0.1/-0.05, 0 and 0.2 for a one-sided one.
    required_share : float or None
        Share of the points that must be within; None: that of the whole part.

    Raises
    ------
    InputError
        If low is not below high, one is not finite, or the share not above 0 and at most 1.

    Examples
    --------
    >>> Tolerance(-0.05, 0.1).size, Tolerance(-0.1, 0.1).equal
    (0.1, True)
    """

    low: float
    high: float
    required_share: float | None = None

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise InputError(
                f"a tolerance lies between two lengths, low < high, such as -0.05 and 0.1; got {self.low!r}, "
                f"{self.high!r}"
            )
        if self.required_share is not None:
            require_share(self.required_share)

    @property
    def equal(self) -> bool:
        """Whether both sides are the same."""
        return self.low == -self.high

    @property
    def size(self) -> float:
        """Largest absolute deviation allowed."""
        return max(abs(self.low), abs(self.high))


def tolerance_of(given: Any, name: str = "tolerance") -> Tolerance:
    """A tolerance from what a caller gives: a length for both sides, or a `Tolerance`.

    >>> tolerance_of(0.1)
    Tolerance(low=-0.1, high=0.1, required_share=None)
    """
    if isinstance(given, Tolerance):
        return given
    require_length(given, name)
    return Tolerance(-float(given), float(given))


def tolerance_from(text: str) -> float | Tolerance:
    """What a text means: a length for both sides, or two signed ones in either order.

    >>> tolerance_from("0.1"), tolerance_from("+0.2/-0.05")
    (0.1, Tolerance(low=-0.05, high=0.2, required_share=None))
    >>> tolerance_from("±0.1"), tolerance_from("-0.05 / +0.2") == tolerance_from("+0.2/-0.05")
    (0.1, True)
    """
    # Drawings, and the program itself, write the minus sign.
    words = text.strip().replace("\u2212", "-")
    found = SIDES.fullmatch(words)
    if found is not None:
        sides = [(sign, float(sign + number)) for sign, number in (found.group(1, 2), found.group(3, 4))]
        if not sides[1][0] and sides[1][1]:
            first, second = found.group(2, 4)
            raise InputError(
                f"{text!r:.100}: the second side has no sign: write +{first}/-{second}, or +{first}/+{second} where "
                "both limits lie outside the part"
            )
        high, low = (number for _, number in sides)
        if low > high and all(sign or not number for sign, number in sides):
            low, high = high, low
        return Tolerance(low, high)
    if (both := BOTH.fullmatch(words)) is not None:
        return float(both.group(1))
    try:
        return float(words)
    except ValueError:
        raise InputError(f"{text!r:.100} is neither a length nor two sides such as +0.2/-0.05") from None


def require_share(share: Any) -> None:
    """Refuse what is no share of points."""
    if not is_number(share) or not 0.0 < share <= 1.0:
        raise InputError(f"required_share must be above 0 and at most 1; got {share!r}")


def share_of_percent(percent: float, name: str) -> float:
    """The share of points that a percentage asks for; what looks like a share already is refused.

    >>> share_of_percent(95.0, "--required")
    0.95
    """
    if 0.0 < percent <= 1.0:
        meant = f": was {100.0 * percent:g} meant?" if percent < 1.0 else ", above 1: was 100 meant?"
        raise InputError(f"{name} is in per cent; got {percent:g}{meant}")
    if not 0.0 < percent <= 100.0:
        raise InputError(f"{name} is a percentage above 1 and at most 100; got {percent:g}")
    return percent / 100.0


@dataclasses.dataclass(frozen=True, eq=False)
class PointLimits:
    """Deviations allowed at some points, (n,) each; infinite where nothing is asked of a face."""

    low: FloatArray
    high: FloatArray

    @property
    def asked(self) -> BoolArray:
        """Points whose face has a tolerance."""
        return np.isfinite(self.high)

    def of(self, rows: Any) -> PointLimits:
        """Those of some of the points."""
        return PointLimits(self.low[rows], self.high[rows])

    def beyond(self, values: FloatArray) -> FloatArray:
        """How far values lie beyond their limits; negative within."""
        return np.maximum(values - self.high, self.low - values)


def limits_at(labels: IntArray, whole: Tolerance | None, faces: Mapping[int, Tolerance]) -> PointLimits:
    """Limits of points on faces, by the number of the face of each, (n,)."""
    low, high = (-math.inf, math.inf) if whole is None else (whole.low, whole.high)
    found = PointLimits(np.full(len(labels), low), np.full(len(labels), high))
    for number, tolerance in faces.items():
        own = labels == number
        found.low[own], found.high[own] = tolerance.low, tolerance.high
    return found
