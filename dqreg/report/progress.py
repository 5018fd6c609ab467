"""A registration as it happens: bar and table on a terminal, a plain line a step when piped, nothing when quiet."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dqreg.records import Iteration
from dqreg.report.time_left import Steps

if TYPE_CHECKING:
    from dqreg.start import Stage

# Rows shown at once: the latest ones; a whole history would scroll away what matters.
ROWS = 12
COLUMNS = ("iteration", "stage", "points", "inliers", "rms", "width", "turn [deg]", "motion [size]")
# Columns of lengths, which carry the target's unit.
LENGTHS = ("rms", "width")
READING = "reading and measuring both sides"
# What the search does after each of its stages.
NEXT = {
    "proposed": "screening {} poses",
    "screened": "refining {} poses roughly",
    "refined roughly": "refining {} poses",
    "refined": "turning {} poses to where the part looks alike",
    "turned": "refining {} poses finely",
    "refined finely": "comparing {} poses",
}


class Progress(Protocol):
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
    """One line a step, for pipes and log files."""

    def __init__(self, console: Console, unit: str | None = None) -> None:
        self._console = console
        self._names = columns(unit)
        self._begun = False

    def __call__(self, iteration: Iteration) -> None:
        """Print one line, under the names of the columns at first."""
        if not self._begun:
            self._line(self._names)
            self._begun = True
        self._line(cells(iteration))

    def search(self, stage: Stage) -> None:
        """Print what the search has done."""
        self._console.out(f"search  {stage_words(stage)}", highlight=False)

    def _line(self, texts: tuple[str, ...]) -> None:
        widths = (max(13, len(name)) for name in self._names)
        self._console.out("  ".join(f"{text:>{width}}" for text, width in zip(texts, widths, strict=True)),
                          highlight=False)  # fmt: skip


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
        self._rows = [*self._rows[1 - ROWS :], iteration]
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
    return tuple(f"{name} [{unit or 'target units'}]" if name in LENGTHS else name for name in COLUMNS)


def stage_words(stage: Stage) -> str:
    """A finished stage of the search in a few words.

    >>> from dqreg.start import Stage
    >>> stage_words(Stage("screened", 160, 0.31))
    'screened, 160 poses left, 0.3 s'
    """
    return f"{stage.name}, {stage.poses:,} pose{'' if stage.poses == 1 else 's'} left, {stage.seconds:.1f} s"


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


def make_progress(console: Console, *, quiet: bool, unit: str | None = None, searching: bool = False) -> Progress:
    """The way to show a registration that suits the console."""
    if quiet:
        return Silent()
    return LiveTable(console, unit, searching=searching) if console.is_terminal else Lines(console, unit)
