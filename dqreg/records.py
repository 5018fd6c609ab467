"""Records that a registration is made of: iterations, verdict, directions, alternatives. Values only."""

from __future__ import annotations

import dataclasses
from typing import Literal

from dqreg.arrays import FloatArray
from dqreg.renamed import warn_of_old_name

Level = Literal["accepted", "suspect", "failed"]


@dataclasses.dataclass(frozen=True)
class Iteration:
    """Record of one iteration.

    Attributes
    ----------
    number : int
        1 for the first.
    stage : str
        Which run of the loop it belongs to. "patient" and "quick" both begin at the start pose, and one of them is
        dropped; "fine" goes on from the other.
    points : int
        Source points used.
    pairs : int
        Pairs with a weight above zero.
    inlier_fraction : float
        Mean weight of all points used.
    rms : float
        Weighted root mean square distance of the pairs, before the step.
    kernel_scale : float
        Width of the robust kernel.
    energy : float
        Mean robust cost before the step, a length squared.
    turn_rad : float
        Rotation of the step.
    motion : float
        Root mean square motion of the points in the step, in sizes of the target; infinite where an extrapolation
        was taken back.
    seconds : float
        Wall time.
    T_target_source : ndarray, (4, 4)
        The pose after the step.
    """

    number: int
    stage: str
    points: int
    pairs: int
    inlier_fraction: float
    rms: float
    kernel_scale: float
    energy: float
    turn_rad: float
    motion: float
    seconds: float
    T_target_source: FloatArray = dataclasses.field(repr=False, compare=False)

    @property
    def scale(self) -> float:
        """Old name of `kernel_scale`, deprecated."""
        warn_of_old_name("Iteration.scale", "kernel_scale")
        return self.kernel_scale


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Whether the pose may be trusted, and why.

    Attributes
    ----------
    level : {"accepted", "suspect", "failed"}
        What to do with the pose: use it, look at it, throw it away.
    reasons : tuple of str
        Sentences, the weightiest first.
    """

    level: Level
    reasons: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Direction:
    """One of six independent motions of the part, and how firmly the matches hold it.

    Attributes
    ----------
    strength : float
        1 would be all pairs working against this motion with the longest lever; 0 is free.
    sigma : float
        Standard deviation of the pose along it, as the largest displacement on the part; NaN where it is free.
    words : str
        The motion in words.
    """

    strength: float
    sigma: float
    words: str


@dataclasses.dataclass(frozen=True)
class Alternative:
    """Another pose that explains the scan about as well.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        The pose.
    score : float
        Truncated root mean square distance of the scan under it, target units; the smaller the better.
    symmetry : str
        The symmetry of the part that leads to it from the answer, in words; "" where it is another pose altogether.
    """

    T_target_source: FloatArray
    score: float
    symmetry: str = ""
