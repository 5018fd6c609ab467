"""Output that cannot be written any more: what comes after it, the files and the exit code stay.

The reader of a pipe goes away, as that of `head -1` does; or a log of the progress is full.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import IO, Any

from rich.console import Console


class PatientConsole(Console):
    """A console that falls silent where its reader is gone; Rich would end the process with exit code 1."""

    def on_broken_pipe(self) -> None:
        """Write no more."""
        self.quiet = True
        into_the_void(self.file)


class Dispensable:
    """A stream for progress: where it cannot be written, the work goes on in silence."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text, or lose it."""
        with self._or_silent():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write what is in the buffer, or lose it."""
        with self._or_silent():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextlib.contextmanager
    def _or_silent(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            into_the_void(self._stream)


def into_the_void(stream: IO[str] | None = None) -> None:
    """Send all further output nowhere: what is left in its buffer would fail once more when Python ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())
