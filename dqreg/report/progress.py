"""A registration as it happens: bar and table on a terminal, a plain line a stage when piped, nothing when quiet."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from dqreg._statuses import SearchStage
from dqreg.files.length_names import column_head
from dqreg.icp.history import Iteration, Stage

# Share of the time that is usually gone when a stage of the search ends, from reading to the verdict: measured on the
# scan that ships with dqreg.
SEARCHED: dict[SearchStage, float] = {
    "proposed": 0.35,
    "screened": 0.38,
    "refined roughly": 0.42,
    "refined": 0.46,
    "turned": 0.54,
    "refined finely": 0.58,
}
# The same before the first iteration, after a given start and after a search; the first iterations of the loop are
# as many as these.
PREPARED_SHARE, FOUND_SHARE = 0.75, 0.95
USUAL_ITERATIONS = 12
BAR_WIDTH = 30


@dataclasses.dataclass(frozen=True)
class Steps:
    """Where a registration is."""

    words: str  # What it does now
    searching: bool = False  # Whether a search for a start comes first
    # Clock in seconds; None takes `time.perf_counter`
    now: Callable[[], float] | None = dataclasses.field(default=None, repr=False)
    began: float | None = None  # Reading of the clock at the beginning
    share: float = 0.0  # Share of the whole that was done at the last step
    following: float = 0.0  # Share that the next step will end with
    # Seconds that the whole will take, as the last step let expect; None where nothing is known yet
    total: float | None = None
    iterations: int = 0  # Iterations so far
    is_over: bool = False  # Whether all is done

    def __post_init__(self) -> None:
        if self.began is None:
            object.__setattr__(self, "began", self._time())

    def searched(self, name: SearchStage, words: str) -> Steps:
        """After a stage of the search."""
        names = list(SEARCHED)
        at = names.index(name) if name in names else len(names) - 1
        following = SEARCHED[names[at + 1]] if at + 1 < len(names) else FOUND_SHARE
        return self._at(SEARCHED[names[at]], following, words)

    def iterated(self, words: str) -> Steps:
        """After an iteration of the loop."""
        first = FOUND_SHARE if self.searching else PREPARED_SHARE
        count = self.iterations + 1
        done = count / (count + USUAL_ITERATIONS)
        more = (count + 1) / (count + 1 + USUAL_ITERATIONS)
        moved = self._at(first + (1.0 - first) * done, first + (1.0 - first) * more, words)
        return dataclasses.replace(moved, iterations=count)

    def ended(self) -> Steps:
        """At the end."""
        return dataclasses.replace(self, share=1.0, is_over=True)

    def left(self) -> float | None:
        """Seconds that the rest will take; None where nothing is known yet, never below zero."""
        return None if self.total is None else max(self.total - self._elapsed(), 0.0)

    def reached(self) -> float | None:
        """Share of the whole that is done by now, between this step and the next; None where nothing is known yet."""
        if self.total is None:
            return None
        return min(max(self.share, self._elapsed() / self.total), self.following)

    def line(self) -> Table:
        """Bar, time gone, time left and what is being done, on one line."""
        reached, left = self.reached(), self.left()
        bar = ProgressBar(total=1.0, completed=reached or 0.0, width=BAR_WIDTH, pulse=reached is None)
        grid = Table.grid(padding=(0, 2))
        gone = f"{self._elapsed():.0f} s"
        grid.add_row(bar, gone, "" if left is None else left_words(left), self.words)
        return grid

    def _at(self, share: float, following: float, words: str) -> Steps:
        return dataclasses.replace(self, share=share, following=following, words=words, total=self._elapsed() / share)

    def _elapsed(self) -> float:
        assert self.began is not None
        return self._time() - self.began

    def _time(self) -> float:
        return (self.now or time.perf_counter)()


def left_words(seconds: float) -> str:
    """A time left as one says it; nothing for NaN."""
    if math.isnan(seconds):
        return ""
    if seconds < 1.0:
        return "a moment left"
    return f"about {seconds:.0f} s left" if seconds < 99.5 else f"about {seconds / 60.0:.0f} min left"


# Rows shown at once: the latest ones; a whole history would scroll away what matters.
SHOWN_ROWS = 12
COLUMNS = ("iteration", "stage", "points", "inliers", "rms", "kernel", "rotation [deg]", "step [size]")
READING = "reading and measuring source and target"
# What the search does after each of its stages.
NEXT: dict[SearchStage, str] = {
    "proposed": "screening {} poses",
    "screened": "refining {} poses roughly",
    "refined roughly": "refining {} poses",
    "refined": "trying {} symmetric poses",
    "turned": "refining {} poses finely",
    "refined finely": "comparing {} poses",
}


class StepDisplay(Protocol):
    """Something that can be shown a registration's steps, inside a ``with`` block."""

    def __enter__(self) -> Self:
        """Begin to show."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop showing."""
        ...

    def __call__(self, iteration: Iteration) -> None:
        """Show one more iteration."""
        ...

    def search(self, stage: Stage) -> None:
        """Show that a stage of the search for a start is done."""
        ...


class Silent:
    """Shows nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def __call__(self, iteration: Iteration) -> None:
        """Do nothing."""

    def search(self, stage: Stage) -> None:
        """Do nothing."""


class Lines(Silent):
    """One line a stage of the search and one a run of the loop, for pipes and log files."""

    def __init__(self, console: Console, unit: str | None = None) -> None:
        self._console = console
        self._unit = unit
        self._runs = 0
        # Iterations of the run so far, and the points of its first: it ends where as few are used again.
        self._count, self._first = 0, 0
        self._last: Iteration | None = None

    def __exit__(self, *_: object) -> None:
        self._told()

    def __call__(self, iteration: Iteration) -> None:
        """Count one more iteration; a pose that is tried anew begins a run of its own."""
        last = self._last
        if last is not None and (
            iteration.stage != last.stage or (iteration.points < last.points and iteration.points <= self._first)
        ):
            self._told()
        if self._last is None:
            self._first = iteration.points
        self._count, self._last = self._count + 1, iteration

    def search(self, stage: Stage) -> None:
        """Print what the search has done."""
        self._told()
        self._console.out(f"search  {stage_words(stage)}", highlight=False)

    def _told(self) -> None:
        """Print the run that ends, if there is one."""
        if self._last is not None:
            self._runs += 1
            self._console.out(f"loop {self._runs}  {run_words(self._last, self._count, self._unit)}", highlight=False)
        self._count, self._last = 0, None


class LiveTable(Silent):
    """A bar with the time left over a table of the latest iterations; both stay in place."""

    def __init__(
        self,
        console: Console,
        unit: str | None = None,
        *,
        searching: bool = False,
        now: Callable[[], float] | None = None,
    ) -> None:
        self._names = columns(unit)
        self._rows: list[Iteration] = []
        self._steps = Steps(READING, searching=searching, now=now)
        # The bar is drawn from the clock, several times a second, whatever the work is doing.
        self._live = Live(console=console, refresh_per_second=8, get_renderable=self._picture)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._steps = self._steps.ended()
        # Without iterations nothing is worth staying on the screen.
        self._live.transient = not self._rows
        self._live.stop()

    def __call__(self, iteration: Iteration) -> None:
        """Show the latest iterations."""
        self._rows = [*self._rows[1 - SHOWN_ROWS :], iteration]
        self._steps = self._steps.iterated(f"iteration {iteration.number}, {iteration.points:,} points")

    def search(self, stage: Stage) -> None:
        """Show how far the search has come."""
        words = NEXT.get(stage.name, "{} poses left").format(f"{stage.poses:,}")
        self._steps = self._steps.searched(stage.name, f"search: {words}")

    def _picture(self) -> RenderableType:
        parts: list[RenderableType] = []
        if self._rows:
            table = Table(box=None)
            for name in self._names:
                # As text: in markup the brackets of a unit would be a style.
                table.add_column(Text(name), justify="right")
            for row in self._rows:
                table.add_row(*cells(row))
            parts.append(table)
        if not self._steps.is_over:
            parts.append(self._steps.line())
        return Group(*parts)


def columns(unit: str | None) -> tuple[str, ...]:
    """Names of the columns, with units."""
    return tuple(column_head(name, unit) for name in COLUMNS)


def stage_words(stage: Stage) -> str:
    """A finished stage of the search in a few words."""
    return f"{stage.name}, {stage.poses:,} pose{'' if stage.poses == 1 else 's'} left, {stage.seconds:.1f} s"


def run_words(last: Iteration, count: int, unit: str | None) -> str:
    """A finished run of the loop in a few words: its iterations, and what the last of them found."""
    return (
        f"{last.stage}, {count} iteration{'' if count == 1 else 's'}, {last.points:,} points, "
        f"{100 * last.inlier_fraction:.1f} % inliers, rms {last.rms:.4g}{f' {unit}' if unit else ''}"
    )


def cells(iteration: Iteration) -> tuple[str, ...]:
    """One iteration as text, in the order of `COLUMNS`."""
    motion = "taken back" if np.isinf(iteration.motion) else f"{iteration.motion:.1e}"
    return (
        str(iteration.number),
        iteration.stage,
        str(iteration.points),
        f"{100 * iteration.inlier_fraction:.1f} %",
        f"{iteration.rms:.4g}",
        f"{iteration.kernel_scale:.4g}",
        f"{np.rad2deg(iteration.turn_rad):.2e}",
        motion,
    )


def make_progress(console: Console, *, quiet: bool, unit: str | None = None, searching: bool = False) -> StepDisplay:
    """The way to show a registration that suits the console."""
    if quiet:
        return Silent()
    return LiveTable(console, unit, searching=searching) if console.is_terminal else Lines(console, unit)
