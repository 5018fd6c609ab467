"""Output into a pipe whose reader goes away, as `head -1` does: the work, its files and its exit code stay."""

from __future__ import annotations

import contextlib
import os
import sys

from rich.console import Console


class PatientConsole(Console):
    """A console that falls silent where its reader is gone; Rich would end the process with exit code 1."""

    def on_broken_pipe(self) -> None:
        """Write no more."""
        self.quiet = True
        into_the_void()


def into_the_void() -> None:
    """Send all further standard output nowhere: what is left in its buffer would fail once more when Python ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
