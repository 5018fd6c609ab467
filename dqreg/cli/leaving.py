"""What Ctrl-C and SIGTERM do: one line and 128 plus the signal's number, whatever the program is at.

Imports next to nothing, because it must stand before anything else is loaded.
"""

from __future__ import annotations

import os
import signal

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType, TracebackType
    from typing import Any, NoReturn, Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)
WORDS = {
    signal.SIGINT: "stopped by the user; no file is left half-written",
    signal.SIGTERM: "ended by a signal (SIGTERM); no file is left half-written",
}


class Signals:
    """What a block does about signals; the handlers of before come back at its end."""

    def __init__(self, handler: Any) -> None:
        self._handler = handler
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        self._before = listen(self._handler)
        for handler in self._before.values():
            # What a compiled module has swallowed on its way in: it was noted, and must not be lost.
            if getattr(handler, "number", 0):
                leave_at_once(handler.number, None)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


def loading() -> Signals:
    """While its block imports things, a signal ends the program at once.

    An interrupt inside an import is swallowed by some compiled modules and comes out of others as an error that says
    that they were damaged. Nothing is held yet that would need tidying up.
    """
    return Signals(leave_at_once)


def listen(handler: Any) -> dict[int, Any]:
    """Have SIGINT and SIGTERM call a function, where Python and the caller allow it."""
    before = {}
    try:
        for number in SIGNALS:
            # What the caller has had ignored (nohup, a job in the background) stays ignored.
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[int(number)] = signal.signal(number, handler)
    except ValueError:
        # Python lets only the main thread listen to signals.
        return {}
    return before


def say(number: int) -> None:
    """Write the one line of a signal to standard error."""
    try:
        # Not through a stream: the signal may have come in the middle of its write.
        os.write(2, f"dqreg: error: {WORDS[signal.Signals(number)]}\n".encode())
    except OSError:
        return  # nobody listens


def leave_at_once(number: int, frame: FrameType | None) -> NoReturn:
    """Write the line of a signal and end the process, without tidying up."""
    say(number)
    os._exit(128 + number)
