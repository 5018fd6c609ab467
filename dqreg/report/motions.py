"""The six motions of a result as something to draw: read back from their words, so that both say the same."""

from __future__ import annotations

import dataclasses
import re
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.trust.records import Direction

NUMBER = r"([-+0-9.e]+|nan)"
TRIPLE = rf"\({NUMBER}, {NUMBER}, {NUMBER}\)"
TURN = re.compile(rf"turn about the axis through {TRIPLE} along {TRIPLE}$")
SHIFT = re.compile(rf"shift along {TRIPLE}$")


@dataclasses.dataclass(frozen=True)
class Motion:
    """A turn about a line or a shift along one."""

    kind: Literal["turn", "shift"]  # Which
    axis: FloatArray  # (3,): Unit direction, target frame
    through: FloatArray  # (3,): A point of the axis, target frame; the place given for a shift
    free: bool  # Whether the scan does not hold it at all


def motion_of(direction: Direction, centre: FloatArray) -> Motion | None:
    """The motion that a direction's words describe."""
    free = direction.words.startswith("free")
    if found := TURN.search(direction.words):
        numbers = [float(text) for text in found.groups()]
        return _motion("turn", numbers[3:], np.array(numbers[:3]), free)
    if found := SHIFT.search(direction.words):
        return _motion("shift", [float(text) for text in found.groups()], centre, free)
    return None


def _motion(kind: Literal["turn", "shift"], axis: list[float], through: FloatArray, free: bool) -> Motion | None:
    direction = np.array(axis)
    length = float(np.linalg.norm(direction))
    if not (0.0 < length < np.inf and np.isfinite(through).all()):
        return None
    return Motion(kind, direction / length, through, free)
