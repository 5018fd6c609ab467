"""Ctrl-C that is never lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self


class Interrupts:
    """Remembers a Ctrl-C inside a ``with`` block, and raises `KeyboardInterrupt` at its end at the latest.

    While compiled modules load, an interrupt is swallowed, or comes out as an error that says they were damaged.
    """

    def __init__(self) -> None:
        self._asked = False
        self._holding = False
        self._before: Any = None

    def __enter__(self) -> Self:
        # Python lets only the main thread listen to signals.
        listening = threading.current_thread() is threading.main_thread()
        # What the caller has had ignored (nohup, a job in the background) stays ignored.
        if listening and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
        self.check()

    def check(self) -> None:
        """Raise `KeyboardInterrupt` if one was asked for."""
        if self._asked:
            raise KeyboardInterrupt

    @contextmanager
    def held(self) -> Iterator[None]:
        """Do nothing about a Ctrl-C until the block has ended."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False
        self.check()

    def checked(self, observe: Callable[[Any], object]) -> Callable[[Any], object]:
        """An observer that ends the work if a Ctrl-C was swallowed before."""

        def watch(record: Any) -> object:
            self.check()
            return observe(record)

        return watch

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._asked = True
        if not self._holding:
            raise KeyboardInterrupt
