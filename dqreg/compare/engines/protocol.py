"""What an engine is: anything that registers, ours or a peer's, seen from outside."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal, Protocol

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud

Setting = Literal["manual", "same-loop"]


@dataclasses.dataclass(frozen=True)
class Task:
    """One registration problem, the same for every engine."""

    source: PointCloud  # The scan, raw, in target units
    target: PointCloud | Mesh  # What it is registered to
    start: FloatArray | None  # (4, 4): Initial pose ``T_target_source``; None asks for global registration
    # "manual": raw data in, pose out, each engine with the preprocessing and parameters that its manual recommends.
    # "same-loop": the points, the maximum distance and the iteration cap below, for everyone
    setting: Setting = "manual"
    # source_points, target_points: (n, 3): Same loop only: the points to use
    source_points: FloatArray | None = None
    target_points: FloatArray | None = None
    # (m, 3): Same loop only: normals of the target points, for engines that take them
    target_normals: FloatArray | None = None
    max_distance: float | None = None  # Same loop only: maximum correspondence distance
    max_iterations: int | None = None  # Same loop only: iteration cap
    threads: int = 2  # Threads that an engine may use
    seed: int = 0  # For engines that draw random numbers
    # Whether intermediate poses are wanted even where an engine must run a second time for them, after the clock has
    # stopped. Engines that report them at no cost always do
    curve: bool = False


@dataclasses.dataclass(frozen=True)
class Step:
    """An intermediate pose, where an engine reports it."""

    iteration: int  # 1 for the first
    seconds: float  # Since the run began; NaN where the engine reports poses but no times
    T_target_source: FloatArray  # (4, 4): The pose after that iteration


@dataclasses.dataclass(frozen=True)
class EngineOutput:
    """What an engine returns for a task; only the pose is required."""

    # (4, 4): The pose as the engine reports it, uncorrected: it may hold a scale or a reflection. All NaN where the
    # engine found nothing or reports failure
    T_target_source: FloatArray
    self_report: str = ""  # What the engine reports about its own success, in a few words
    iterations: int | None = None  # Where the engine reports it
    curve: tuple[Step, ...] = ()  # Intermediate poses; empty where the engine reports none
    seconds: float = math.nan  # From raw data to pose, preprocessing included; NaN takes the time measured from outside
    # The part of it that a second scan to the same target would not need again; NaN where it is unknown
    prepare_seconds: float = math.nan
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)  # Every parameter it ran with, as resolved


class Engine(Protocol):
    """Anything that registers; an object with a name and `register` will do, the rest has defaults."""

    # Properties, so that frozen dataclasses satisfy the protocol as well as plain attributes do.
    @property
    def name(self) -> str:
        """Shown in tables."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """Distributions needed beyond dqreg's own dependencies; () if absent."""
        ...

    @property
    def needs_initial_pose(self) -> bool:
        """Whether it cannot do without an initial pose; True if absent."""
        ...

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The settings it takes part in; "manual" alone if absent."""
        ...

    def register(self, task: Task) -> EngineOutput:
        """Do the task; a bare 4x4 pose is taken as well."""
        ...
