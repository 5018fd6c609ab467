"""Length units: names, spellings, the factor between two of them, and which are likely to be confused."""

from __future__ import annotations

import re
from collections.abc import Collection
from fractions import Fraction

from dqreg.errors import UnitsError, did_you_mean

# Exact by definition, so that their ratios are rounded once.
METRES = {
    "um": Fraction(1, 1_000_000),
    "mm": Fraction(1, 1_000),
    "cm": Fraction(1, 100),
    "m": Fraction(1),
    "inch": Fraction(254, 10_000),
    "ft": Fraction(3_048, 10_000),
}
# Pairs of units that are confused, coarser and finer: the likely ones first.
MIXED = (("m", "mm"), ("inch", "mm"), ("cm", "mm"), ("m", "cm"), ("ft", "mm"), ("mm", "um"), ("m", "um"))
# Those that are confused less often, or whose ratio is that of many a patch to its part: sizes must agree closely.
MIXED_RARELY = (("m", "ft"), ("inch", "cm"), ("ft", "inch"), ("m", "inch"), ("ft", "cm"))


def factor(source: str | None, target: str | None) -> float:
    """What source lengths are multiplied with to be in target units; 1 where either unit is unknown."""
    for name in (source, target):
        if name is not None and (not isinstance(name, str) or name not in METRES):
            raise UnitsError(f"unknown length unit {name!r}; known are {', '.join(METRES)}{unit_meant(name, METRES)}")
    if source is None or target is None:
        return 1.0
    return float(METRES[source] / METRES[target])


# Ratios of at least one between the units of scans and parts; none of these is measured in micrometres.
RATIOS = tuple(sorted({factor(a, b) for a in METRES for b in METRES if "um" not in (a, b) and factor(a, b) >= 1.0}))

UNIT_WORDS = {
    **dict.fromkeys(["um", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"], "um"),
    **dict.fromkeys(["mm", "millimeter", "millimeters", "millimetre", "millimetres"], "mm"),
    **dict.fromkeys(["cm", "centimeter", "centimeters", "centimetre", "centimetres"], "cm"),
    **dict.fromkeys(["m", "meter", "meters", "metre", "metres"], "m"),
    **dict.fromkeys(["in", "inch", "inches"], "inch"),
    **dict.fromkeys(["ft", "foot", "feet"], "ft"),
}
# The whole comment must say it: "units mm", "Unit: mm", "Model units = millimeters".
STATEMENT = re.compile(r"(?:(?:file|model|length)[ _])?units?\s*[:=]?\s*([a-z]+)\.?", re.IGNORECASE)


def unit_meant(name: object, known: Collection[str]) -> str:
    """The end of a message about a unit that is not known: the one of those known that was meant, or nothing.

    >>> unit_meant("Millimetres", METRES), unit_meant("feet", METRES), unit_meant("um", ["mm"]), unit_meant(3, METRES)
    ('; did you mean mm?', '; did you mean ft?', '', '')
    """
    if not isinstance(name, str):
        return ""
    meant = UNIT_WORDS.get(name.strip().lower())
    return f"; did you mean {meant}?" if meant is not None and meant in known else did_you_mean(name, known)


def unit_of_comment(comment: str) -> str | None:
    """Length unit that a comment states and nothing else, or None."""
    stated = STATEMENT.fullmatch(comment.strip())
    return UNIT_WORDS.get(stated.group(1).lower()) if stated else None
