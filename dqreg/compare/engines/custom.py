"""An engine made of a function: the short way for a method of one's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg.compare.engines.harness import Clock, Found, timed
from dqreg.compare.engines.protocol import Attempt, Setting, Task
from dqreg.errors import InputError


@dataclasses.dataclass(frozen=True)
class FunctionEngine:
    """An engine that calls a function and takes the time.

    Pass it wherever the name of an engine is accepted. It can be sent to other processes if the function stands at the
    top of a module.
    """

    name: str  # Shown in tables
    # From a `Task` to the pose ``T_target_source``, (4, 4); NaN or None where it found none. Whatever it raises is
    # raised
    function: Callable[[Task], ArrayLike | None]
    needs: tuple[str, ...] = ()  # Distributions it needs
    from_nothing: bool = False  # Whether it can do without a start
    settings: tuple[Setting, ...] = ("manual",)  # The settings it takes part in
    parameters: dict[str, Any] = dataclasses.field(default_factory=dict)  # Written into the settings of each run

    def register(self, task: Task) -> Attempt:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings))

    def _work(self, task: Task, clock: Clock, settings: dict[str, Any]) -> Found:
        settings.update(self.parameters)
        answer = self.function(task)
        T = np.full((4, 4), np.nan) if answer is None else np.array(answer, dtype=np.float64)
        if T.shape != (4, 4):
            raise InputError(f"the engine {self.name!r} must return a 4x4 pose or None; got shape {T.shape}")
        # What part of the time went into the target, a function cannot tell.
        clock.prepared = np.nan
        return Found(T, "")
