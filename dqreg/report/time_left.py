"""How much of a registration is done and how long the rest will take, from what its steps usually cost."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from rich.progress_bar import ProgressBar
from rich.table import Table

# Share of the time that is usually gone when a stage of the search ends, from reading to the verdict: measured on the
# scan that ships with dqreg.
SEARCHED = {
    "proposed": 0.35,
    "screened": 0.38,
    "refined roughly": 0.42,
    "refined": 0.46,
    "turned": 0.54,
    "refined finely": 0.58,
}
# The same before the first iteration, after a search and after a given start; the first iterations of the loop are
# as many as these.
PREPARED, FOUND = 0.75, 0.95
ITERATIONS = 12
WIDTH = 30


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

    def searched(self, name: str, words: str) -> Steps:
        """After a stage of the search."""
        names = list(SEARCHED)
        at = names.index(name) if name in names else len(names) - 1
        following = SEARCHED[names[at + 1]] if at + 1 < len(names) else FOUND
        return self._at(SEARCHED[names[at]], following, words)

    def iterated(self, words: str) -> Steps:
        """After an iteration of the loop."""
        first = FOUND if self.searching else PREPARED
        count = self.iterations + 1
        done = count / (count + ITERATIONS)
        more = (count + 1) / (count + 1 + ITERATIONS)
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
        bar = ProgressBar(total=1.0, completed=reached or 0.0, width=WIDTH, pulse=reached is None)
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
    """A time left as one says it.

    >>> left_words(0.2), left_words(7.6), left_words(150.0)
    ('a moment left', 'about 8 s left', 'about 2 min left')
    """
    if seconds < 1.0:
        return "a moment left"
    return f"about {seconds:.0f} s left" if seconds < 99.5 else f"about {seconds / 60.0:.0f} min left"
