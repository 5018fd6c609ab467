"""A time limit that the loop hears of through its observer."""

from __future__ import annotations

import dataclasses
import time

from dqreg.icp import Observer
from dqreg.icp.history import Iteration
from dqreg.solvers.status import Status


@dataclasses.dataclass(frozen=True)
class Deadline:
    """When to end."""

    began: float  # Reading of `time.perf_counter` at the beginning
    limit: float | None  # Seconds from then on; None never ends

    @property
    def left(self) -> float | None:
        """Seconds left, at least a moment; None without a limit."""
        return None if self.limit is None else max(self.began + self.limit - time.perf_counter(), 1e-9)

    @property
    def is_over(self) -> bool:
        """Whether the time is up."""
        return self.limit is not None and time.perf_counter() > self.began + self.limit

    def watching(self, observe: Observer | None) -> Observer | None:
        """The observer, which also ends the loop when the time is up."""
        if self.limit is None:
            return observe

        def watch(record: Iteration) -> object:
            told = None if observe is None else observe(record)
            return False if self.is_over else told

        return watch

    def status(self, status: Status) -> Status:
        """Status of the loop, with the true cause where it was stopped for the time."""
        return "time limit" if status == "stopped by observer" and self.is_over else status
