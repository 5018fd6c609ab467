"""Many pieces of work as they get done: a bar with the time left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Iterable
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from dqreg.errors import printable
from dqreg.report.progress import left_words


class TimeLeft:
    """Estimate of the time that is left.

    Kinds of work differ a thousandfold in speed, so each has its own rate; one that was not done yet gets the mean.
    """

    def __init__(self, jobs: Iterable[tuple[Hashable, float]]) -> None:
        self._left: dict[Hashable, float] = {}
        self._worked: dict[Hashable, float] = {}
        self._spent: dict[Hashable, float] = {}
        for kind, work in jobs:
            self._left[kind] = self._left.get(kind, 0.0) + work

    def done(self, kind: Hashable, work: float, seconds: float) -> None:
        """Count a job as done."""
        self._left[kind] = self._left.get(kind, 0.0) - work
        if seconds > 0.0:
            self._worked[kind] = self._worked.get(kind, 0.0) + work
            self._spent[kind] = self._spent.get(kind, 0.0) + seconds

    @property
    def seconds(self) -> float:
        """Seconds that the remaining jobs will take; NaN before the first is done."""
        worked = sum(self._worked.values())
        if not worked:
            return math.nan
        mean = sum(self._spent.values()) / worked
        rates = {kind: self._spent[kind] / work for kind, work in self._worked.items() if work}
        return sum(max(0.0, left) * rates.get(kind, mean) for kind, left in self._left.items())


class WorkBar:
    """A bar that stays in place on a terminal; nothing elsewhere, and nothing on a quiet console."""

    def __init__(self, console: Console, *, counted: bool = True) -> None:
        self._bar: Progress | None = None
        self._task: Any = None
        if console.is_terminal and not console.quiet:
            self._bar = Progress(
                BarColumn(), MofNCompleteColumn() if counted else TaskProgressColumn(), TimeElapsedColumn(),
                TextColumn("{task.fields[left]}"), TextColumn("{task.description}", markup=False),
                console=console, transient=True,
            )  # fmt: skip
            self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, done: float, total: float, seconds_left: float, words: str) -> bool:
        """Move the bar; False where there is none."""
        if self._bar is not None:
            self._bar.update(
                self._task, completed=done, total=total, description=printable(words), left=left_words(seconds_left)
            )
        return self._bar is not None

    def steps(self, total: int, words: str) -> Callable[..., None]:
        """To be called at each of so many equal steps."""
        left, now = TimeLeft([("", total)]), time.monotonic()
        done = 0

        def step(*_: object) -> None:
            nonlocal done, now
            before, now, done = now, time.monotonic(), done + 1
            left.done("", 1.0, now - before)
            self.show(done, total, left.seconds, words)

        self.show(0, total, math.nan, words)
        return step
