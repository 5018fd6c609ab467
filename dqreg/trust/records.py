"""Records that a registration is made of: iterations, verdict, directions, alternatives. Values only."""

from __future__ import annotations

import dataclasses
from typing import Literal

from dqreg._arrays import FloatArray

Level = Literal["accepted", "suspect", "failed"]


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Whether the pose may be trusted, and why."""

    level: Level  # What to do with the pose: use it, look at it, throw it away
    reasons: tuple[str, ...]  # Sentences, the weightiest first


@dataclasses.dataclass(frozen=True)
class Direction:
    """One of six independent motions of the part, and how firmly the matches hold it."""

    strength: float  # 1 would be all pairs working against this motion with the longest lever; 0 is free
    # Standard deviation of the pose along it, as the largest displacement on the part; NaN where it is free
    sigma: float
    words: str  # The motion in words


@dataclasses.dataclass(frozen=True)
class Alternative:
    """Another pose that explains the scan about as well."""

    T_target_source: FloatArray  # (4, 4): The pose
    score: float  # Truncated root mean square distance of the scan under it, target units; the smaller the better
    # The symmetry of the part that leads to it from the answer, in words; "" where it is another pose altogether
    symmetry: str = ""
