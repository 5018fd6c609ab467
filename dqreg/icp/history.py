"""Records of what a registration has done: the iterations of ICP and the stages of the global search."""

from __future__ import annotations

import dataclasses

from dqreg._arrays import FloatArray
from dqreg._records import made_of, read_only
from dqreg._statuses import SearchStage
from dqreg.errors import warn_of_old_name


@dataclasses.dataclass(frozen=True)
class Iteration:
    """Record of one iteration."""

    number: int  # 1 for the first
    # Which run of the loop it belongs to. "coarse" and "annealed" both begin at the start pose, and one of them is
    # dropped; "fine" goes on from the other, and "common faces" from that, between clouds
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_target_source", read_only(self.T_target_source))

    def at(self, T_target_source: FloatArray) -> Iteration:
        """The same record with its pose between other frames."""
        return made_of(Iteration, {**vars(self), "T_target_source": read_only(T_target_source)})

    @property
    def scale(self) -> float:
        """Old name of `kernel_scale`, deprecated."""
        warn_of_old_name("Iteration.scale", "kernel_scale")
        return self.kernel_scale


@dataclasses.dataclass(frozen=True)
class Stage:
    """Report of one stage of the global search."""

    name: SearchStage  # What was done
    poses: int  # Poses that are left
    seconds: float  # Time since the search began
