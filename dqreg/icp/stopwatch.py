"""Time of a registration: seconds per stage, and a limit that the loop hears of through its observer."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

import numpy as np

from dqreg.icp.history import Iteration
from dqreg.icp.loop import TIME_IS_UP, Observer
from dqreg.kernels.compiling.compiled import CLOCK


class Stopwatch:
    """Runs from when it is made."""

    def __init__(self, limit: float | None = None) -> None:
        self._began = time.perf_counter()
        self._limit = limit
        self._compiled = CLOCK.seconds
        self.seconds: dict[str, float] = {}  # Of each stage that has ended

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Times what is done inside."""
        began = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - began

    def end(self) -> None:
        """Note what the whole took and, where kernels were compiled meanwhile, how much of it that was."""
        self.seconds["total"] = self.total
        if (compiled := CLOCK.seconds - self._compiled) > 0.0:
            self.seconds["compile"] = compiled

    @property
    def total(self) -> float:
        """Seconds so far."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float | None:
        """Seconds up to the limit, at least a moment; None without a limit."""
        return None if self._limit is None else max(self._limit - self.total, 1e-9)

    @property
    def deadline(self) -> float:
        """When the limit is over, by `time.perf_counter`; infinite without one."""
        return np.inf if self._limit is None else self._began + self._limit

    @property
    def is_over(self) -> bool:
        """Whether the time is up."""
        return self._limit is not None and self.total > self._limit

    def watching(self, observe: Observer | None) -> Observer | None:
        """The observer, which also ends the loop when the time is up."""
        if self._limit is None:
            return observe

        def watch(record: Iteration) -> object:
            answer = None if observe is None else observe(record)
            return TIME_IS_UP if self.is_over else answer

        return watch
