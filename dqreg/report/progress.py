"""Iterations as they happen: a live table on a terminal, one plain line each when piped, nothing when quiet."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol, Self

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table

from dqreg.records import Iteration

# Rows shown at once: the latest ones; a whole history would scroll away what matters.
ROWS = 12
COLUMNS = ("iteration", "stage", "points", "inliers", "rms", "width", "turn [deg]", "motion [size]")


class Progress(Protocol):
    """Something that can be shown iterations, inside a ``with`` block."""

    def __enter__(self) -> Self:
        """Begin to show."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop showing."""
        ...

    def __call__(self, iteration: Iteration) -> None:
        """Show one more."""
        ...


class Silent:
    """Shows nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def __call__(self, iteration: Iteration) -> None:
        """Do nothing."""


class Lines(Silent):
    """One line an iteration, for pipes and log files."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._begun = False

    def __call__(self, iteration: Iteration) -> None:
        """Print one line, under the names of the columns at first."""
        if not self._begun:
            self._console.out("  ".join(f"{name:>13}" for name in COLUMNS), highlight=False)
            self._begun = True
        self._console.out("  ".join(f"{cell:>13}" for cell in cells(iteration)), highlight=False)


class LiveTable(Silent):
    """A table of the latest iterations that stays in place."""

    def __init__(self, console: Console) -> None:
        self._rows: list[Iteration] = []
        self._live = Live(console=console, refresh_per_second=8)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._rows:
            self._live.update(self._table(), refresh=True)
            self._live.stop()

    def __call__(self, iteration: Iteration) -> None:
        """Show the latest iterations."""
        if not self._rows:
            self._live.start()
        self._rows = [*self._rows[1 - ROWS :], iteration]
        self._live.update(self._table())

    def _table(self) -> Table:
        table = Table(box=None)
        for name in COLUMNS:
            table.add_column(name, justify="right")
        for row in self._rows:
            table.add_row(*cells(row))
        return table


def cells(iteration: Iteration) -> tuple[str, ...]:
    """One iteration as text, in the order of `COLUMNS`.

    Parameters
    ----------
    iteration : Iteration
        Record of the loop.

    Returns
    -------
    tuple of str
        Lengths in the target's unit; "taken back" where an extrapolation was.
    """
    motion = "taken back" if np.isinf(iteration.motion) else f"{iteration.motion:.1e}"
    return (
        str(iteration.number),
        iteration.stage,
        str(iteration.points),
        f"{100 * iteration.inlier_fraction:.1f} %",
        f"{iteration.rms:.4g}",
        f"{iteration.scale:.4g}",
        f"{np.rad2deg(iteration.turn_rad):.2e}",
        motion,
    )


def make_progress(console: Console, *, quiet: bool) -> Progress:
    """The way to show iterations that suits the console.

    Parameters
    ----------
    console : Console
        Where to.
    quiet : bool
        Whether to show nothing.

    Returns
    -------
    Progress
        Live on a terminal, lines in a pipe.

    Examples
    --------
    >>> type(make_progress(Console(), quiet=True)).__name__
    'Silent'
    """
    if quiet:
        return Silent()
    return LiveTable(console) if console.is_terminal else Lines(console)
