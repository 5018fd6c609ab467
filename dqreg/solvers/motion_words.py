"""Motions of a part as values, and in words: a rotation about an axis, or a translation along one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

from dqreg._arrays import FloatArray

Kind = Literal["rotation", "translation"]
Vector = tuple[float, float, float]
UNKNOWN: Vector = (math.nan, math.nan, math.nan)


@dataclasses.dataclass(frozen=True)
class Motion:
    """A rotation about an axis, or a translation along one."""

    kind: Kind
    axis: Vector  # Unit vector; an axis has no sign, so its largest component is positive
    point: Vector  # The point of the axis nearest to a centre; the centre for a translation

    @staticmethod
    def of(twist: Sequence[float], centre: Sequence[float], kind: Kind) -> Motion:
        """The motion of a twist about a centre; of a rotation, the part along its axis is left out."""
        # Number by number: NumPy takes several times as long for as few.
        u, v, w, x, y, z = twist
        a, b, c = centre
        if kind == "rotation":
            square = u * u + v * v + w * w
            # The foot of the centre.
            a, b, c = a + (v * z - w * y) / square, b + (w * x - u * z) / square, c + (u * y - v * x) / square
            x, y, z = u, v, w
        size = math.copysign(math.hypot(x, y, z), max(x, y, z, key=abs))
        return Motion(kind, (x / size, y / size, z / size), (a, b, c))

    @property
    def words(self) -> str:
        """The motion in words, where the length unit is not known."""
        return self.words_in(None)

    def words_in(self, units: str | None) -> str:
        """The motion in words, given the length unit of its point."""
        if self.kind == "translation":
            return f"translation along {direction_words(self.axis)}"
        return f"rotation about {axis_words(self.point, self.axis, units)}"


def axis_words(
    point: FloatArray | Vector, unit: FloatArray | Vector, units: str | None = None, size: float = 0.0
) -> str:
    """A line in space; coordinates that are zero but for rounding, given the size of the part, as zero.

    >>> axis_words((1.0, -1e-17, 20.5), (0.0, 0.6, 0.8), "mm")
    'the axis through (1, 0, 20.5) mm along (0.00, 0.60, 0.80)'
    """
    least = max(1e-6 * max(map(abs, point)), 1e-6 * size)
    x, y, z = (c if abs(c) >= least else 0.0 for c in point)
    place = f"({x:.4g}, {y:.4g}, {z:.4g})" + (f" {units}" if units else "")
    return f"the axis through {place} along {direction_words(unit)}"


def direction_words(unit: FloatArray | Vector) -> str:
    """A unit vector to two decimals, minus zero as zero.

    >>> direction_words((1.0, -0.001, 0.0))
    '(1.00, 0.00, 0.00)'
    """
    x, y, z = (c if abs(c) >= 0.005 else 0.0 for c in unit)
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
