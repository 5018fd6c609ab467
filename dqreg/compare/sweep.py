"""A sweep: axes along which one parameter is varied, and the base from which it is varied."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

from dqreg.compare.engines.protocol import Setting

AxisName = Literal["start_angle_deg", "start_offset", "noise", "outliers", "overlap", "points", "frame", "nothing"]

# Unit and origin of the coordinates: the unit, its factor from millimetres, and an offset added after it.
FRAMES: dict[str, tuple[str, float, tuple[float, float, float]]] = {
    "mm": ("mm", 1.0, (0.0, 0.0, 0.0)),
    "m": ("m", 1e-3, (0.0, 0.0, 0.0)),
    "m, UTM": ("m", 1e-3, (389_000.0, 5_819_000.0, 40.0)),
}


@dataclasses.dataclass(frozen=True)
class Cell:
    """One task of a sweep, before it is made; lengths in S, the part's diagonal."""

    axis: str  # Parameter that is varied
    value: float | str  # Its value
    trial: int  # Seed of scan, frame and initial pose
    setting: Setting = "manual"
    part: str = "bracket"  # Kind of part, as in recipes
    points: int = 20_000  # Scan points
    # start_angle_deg, start_offset: Rotation and translation of the initial pose from the true one
    start_angle_deg: float = 8.0
    start_offset: float = 0.03
    noise: float = 3e-4  # Standard deviation of the range
    outliers: float = 0.02  # Fraction of outliers
    # None: the scan to the CAD mesh. Else scan to scan, and the fraction of the source that the target has too
    overlap: float | None = None
    frame: str = "mm"  # "mm", "m" or "m, UTM": unit and origin of the coordinates
    nothing: str = ""  # Kind of part for tasks without an initial pose; "" for tasks with one

    @property
    def key(self) -> str:
        """Name in files: every number that makes the task."""
        return "sweep 1|" + "|".join(str(value) for value in dataclasses.astuple(self))


@dataclasses.dataclass(frozen=True)
class SweepAxis:
    """One axis of a sweep."""

    name: str  # Parameter that is varied
    values: tuple[float | str, ...]
    trials: int = 1  # Tasks at each value
    settings: tuple[Setting, ...] = ("manual",)
    repeats: int = 1  # Timed runs of each task
    more_engines: tuple[str, ...] = ()  # Engines that take part on this axis besides those of the sweep


@dataclasses.dataclass(frozen=True)
class Sweep:
    """Axes and what they share."""

    name: str  # Title
    base: dict[str, Any]  # Fields of `Cell` that differ from its defaults
    axes: tuple[SweepAxis, ...]  # In their order
    timeout: float = 60.0  # Time limit of a single run in seconds
    engines: tuple[str, ...] = ()  # Engines that take part unless the caller names others; () for all of the registry

    @property
    def all_engines(self) -> tuple[str, ...]:
        """Engines of the sweep and of all axes, each once."""
        return tuple(dict.fromkeys([*self.engines, *(name for axis in self.axes for name in axis.more_engines)]))

    def excluded(self, axis_name: str) -> frozenset[str]:
        """Engines that take part on other axes only."""
        here = {name for axis in self.axes if axis.name == axis_name for name in axis.more_engines}
        return frozenset(set(self.all_engines) - set(self.engines) - here)

    def cells(self) -> list[tuple[Cell, int]]:
        """Every cell with the number of its timed runs, axis by axis."""
        return [
            (self._cell(axis, value, trial, setting), axis.repeats)
            for axis in self.axes
            for value in axis.values
            for setting in axis.settings
            for trial in range(axis.trials)
        ]

    def _cell(self, axis: SweepAxis, value: float | str, trial: int, setting: Setting) -> Cell:
        values = {**self.base, axis.name: value}
        if axis.name == "nothing":
            values["part"] = value
        return Cell(axis=axis.name, value=value, trial=trial, setting=setting, **values)
