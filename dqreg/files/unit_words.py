"""Length units as people write them in the headers of files."""

from __future__ import annotations

import re

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


def unit_of_comment(comment: str) -> str | None:
    """Length unit that a comment states and nothing else, or None."""
    stated = STATEMENT.fullmatch(comment.strip())
    return UNIT_WORDS.get(stated.group(1).lower()) if stated else None
