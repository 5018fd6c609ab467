"""Numbers as a reader wants them: few digits, a true minus sign, words for what is not known."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray

# Settings that are lengths in the target's unit.
LENGTHS = frozenset({"max_distance", "width", "source_noise", "source_spacing", "diagonal", "centre", "near", "reach"})


def text_of(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """A number in a few digits."""
    if value is None or np.isnan(value):
        return "not known"
    if np.isinf(value):
        return "no limit" if value > 0 else "−∞"
    text = f"{value:{'+' if sign and value else ''}.{digits}g}"
    return text.replace("-", "−") if not text.count("e") else text.replace("-", "−", 1) if value < 0 else text


def percent(share: float) -> str:
    """A share in percent, never rounded to all or nothing.

    >>> percent(0.5), percent(1.0), percent(0.99999), percent(1e-7)
    ('50.0', '100', '> 99.9', '< 0.1')
    """
    if np.isnan(share):
        return "not known"
    if share in (0.0, 1.0):
        return f"{100.0 * share:.0f}"
    if share < 0.001:
        return "< 0.1"
    return "> 99.9" if share > 0.999 else f"{100.0 * share:.1f}"


def place_text(point: FloatArray) -> str:
    """Coordinates of a place.

    >>> place_text(np.array([1.0, -2.5, 1e6]))
    '(1, −2.5, 1000000)'
    """
    return "(" + ", ".join(f"{x:.7g}".replace("-", "−") for x in np.round(point, 12) + 0.0) + ")"


def setting_text(name: str, value: Any, unit: str) -> str:
    """A setting with its unit.

    >>> setting_text("width", 0.5, "mm"), setting_text("max_angle_deg", 60.0, "mm"), setting_text("seed", 0, "mm")
    ('0.5 mm', '60 degrees', '0')
    """
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        words = ", ".join(setting_text("", item, unit) for item in value)
        return f"({words}) {unit}" if name in LENGTHS else f"({words})"
    if isinstance(value, float):
        text = text_of(value, 6)
        return f"{text} {unit}" if name in LENGTHS else f"{text} degrees" if name.endswith("_deg") else text
    return str(value)
