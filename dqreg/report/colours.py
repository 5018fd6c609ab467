"""The colours of reports and pictures, one set for both: told apart by all kinds of colour vision.

Deviations have the colours of the files that `Deviations.save` writes: blue inside, near white, orange outside. What
lies beyond the scale has colours of its own, so that clipping is seen.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray
from dqreg.inspection.deviations.files import colours_of
from dqreg.inspection.tolerances import PointLimits

TARGET = "#b9bec6"
SOURCE = "#d96f00"
ALIGNED = "#1f77c9"
OFF_PART = "#7d8590"
# Okabe and Ito's bluish green, orange and vermilion; each comes with a word and a sign, never alone.
LEVELS = {"accepted": "#009e73", "suspect": "#e69f00", "failed": "#d55e00"}

# Codes of a scale: 0 is below it, 255 above it.
FIRST_CODE, LAST_CODE = 1, 254

ByteArray = NDArray[np.uint8]


@dataclasses.dataclass(frozen=True)
class Scale:
    """From a deviation to a colour."""

    limit: float  # Where the scale ends, target units; it begins at ``-limit``, or at 0 without signs
    signed: bool  # Whether deviations have signs

    @property
    def low(self) -> float:
        """Where the scale begins, target units."""
        return -self.limit if self.signed else 0.0

    def codes(self, values: FloatArray, allowed: PointLimits | None = None) -> ByteArray:
        """Code of each value: 0 below the scale, 255 above it, 1 to 254 along it.

        What is out of the tolerance of its own face is below or above, though the scale ends at the largest.
        """
        share = (values - self.low) / (self.limit - self.low)
        codes = np.rint(FIRST_CODE + (LAST_CODE - FIRST_CODE) * np.clip(share, 0.0, 1.0)).astype(np.uint8)
        codes[share < 0.0] = 0
        codes[~(share <= 1.0)] = 255
        if allowed is not None:
            codes[values < allowed.low] = 0
            codes[values > allowed.high] = 255
        return codes

    def table(self) -> ByteArray:
        """Colour of each code. Shapes: returns (256, 3)."""
        step = (self.limit - self.low) / (LAST_CODE - FIRST_CODE)
        values: FloatArray = self.low + step * (np.arange(256.0) - FIRST_CODE)
        values[[0, FIRST_CODE, LAST_CODE, 255]] = [-2.0 * self.limit, self.low, self.limit, 2.0 * self.limit]
        return colours_of(values, self.limit)

    def css(self) -> tuple[str, str, str]:
        """The scale for a style sheet: a gradient from low to high, the colour below, the colour beyond."""
        table = self.table()
        names = [f"rgb({r},{g},{b})" for r, g, b in table.tolist()]
        stops = names[FIRST_CODE : LAST_CODE + 1 : 11]
        return f"linear-gradient(90deg,{','.join(stops)})", names[0], names[255]


def rgb(colour: str) -> tuple[int, int, int]:
    """Numbers of a colour."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def nice_above(value: float) -> float:
    """The least of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is not below a number."""
    if not 0.0 < value < np.inf:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    steps: Any = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0]) * power
    return float(f"{steps[np.argmax(steps >= value * (1.0 - 1e-9))]:.6g}")
