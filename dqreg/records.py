"""Records that a registration is made of: iterations, verdict, directions, alternatives. Values only."""

from __future__ import annotations

import dataclasses
from typing import Literal

from dqreg.arrays import FloatArray
from dqreg.renamed import warn_of_old_name

Level = Literal["accepted", "suspect", "failed"]


@dataclasses.dataclass(frozen=True)
class Iteration:
    """Record of one iteration."""

    number: int  # 1 for the first
    # Which run of the loop it belongs to. "patient" and "quick" both begin at the start pose, and one of them is
    # dropped; "fine" goes on from the other
    stage: str
    points: int  # Source points used
    pairs: int  # Pairs with a weight above zero
    inlier_fraction: float  # Mean weight of all points used
    rms: float  # Weighted root mean square distance of the pairs, before the step
    kernel_scale: float  # Width of the robust kernel
    energy: float  # Mean robust cost before the step, a length squared
    turn_rad: float  # Rotation of the step
    # Root mean square motion of the points in the step, in sizes of the target; infinite where an extrapolation was
    # taken back
    motion: float
    seconds: float  # Wall time
    T_target_source: FloatArray = dataclasses.field(repr=False, compare=False)  # (4, 4): The pose after the step

    @property
    def scale(self) -> float:
        """Old name of `kernel_scale`, deprecated."""
        warn_of_old_name("Iteration.scale", "kernel_scale")
        return self.kernel_scale


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
