"""What an engine is: anything that registers, ours or a peer's, seen from outside."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, Protocol

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud

Setting = Literal["manual", "same-loop"]


@dataclasses.dataclass(frozen=True)
class Task:
    """One registration to be done, the same for every engine."""

    source: PointCloud  # The scan, raw, in target units
    target: PointCloud | Mesh  # What it is registered to
    start: FloatArray | None  # (4, 4): ``T_target_source`` to begin with; None asks for the pose from nothing
    # "manual": raw data in, pose out, each engine with the preprocessing and parameters that its manual recommends.
    # "same-loop": the points, the distance limit and the iteration cap below, for everyone
    setting: Setting = "manual"
    # source_points, target_points: (n, 3): Same loop only: the points to use
    source_points: FloatArray | None = None
    target_points: FloatArray | None = None
    # (m, 3): Same loop only: normals of the target points, for engines that take them
    target_normals: FloatArray | None = None
    max_distance: float | None = None  # Same loop only: largest distance of a pair
    max_iterations: int | None = None  # Same loop only: iteration cap
    threads: int = 2  # Threads that an engine may use
    seed: int = 0  # For engines that draw
    # Whether poses on the way are wanted even where an engine must run a second time for them, after the clock has
    # stopped. Engines that reveal them for nothing always do
    curve: bool = False


@dataclasses.dataclass(frozen=True)
class Step:
    """A pose on the way, where an engine reveals it."""

    iteration: int  # 1 for the first
    seconds: float  # Since the run began; NaN where the engine reveals poses but no times
    T_target_source: FloatArray  # (4, 4): The pose after that iteration


@dataclasses.dataclass(frozen=True)
class Attempt:
    """What an engine made of a task."""

    # (4, 4): The pose as the engine reports it, not mended: it may hold a scale or a mirror. All NaN where the engine
    # found nothing or says that it failed
    T_target_source: FloatArray
    seconds: float  # From raw data to pose, preprocessing included
    # The part of it that a second scan to the same target would not need again; NaN where it cannot be told apart
    prepare_seconds: float
    iterations: int | None  # Where the engine tells
    claims: str  # What the engine says about its own success, in a few words; "" where it says nothing
    settings: dict[str, Any]  # Every parameter it ran with, as resolved
    curve: tuple[Step, ...] = ()  # Poses on the way; empty where the engine reveals none


class Engine(Protocol):
    """Anything that registers."""

    # Properties, so that frozen dataclasses satisfy the protocol as well as plain attributes do.
    @property
    def name(self) -> str:
        """Shown in tables."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """Distributions needed beyond dqreg's own dependencies."""
        ...

    @property
    def from_nothing(self) -> bool:
        """Whether it can do without a start."""
        ...

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The settings it takes part in."""
        ...

    def register(self, task: Task) -> Attempt:
        """Do the task."""
        ...
