"""What Ctrl-C, SIGTERM and SIGHUP do: one line and 128 plus the signal's number, whatever the program is doing.

Imports next to nothing, because it must stand before anything else is loaded.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time

from dqreg.cli.exit_codes import SIGNAL_CODE

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType, TracebackType
    from typing import Any, NoReturn, Self

# A terminal that is closed sends the last; Windows has none.
HANGUP = getattr(signal, "SIGHUP", None)
SIGNALS = (signal.SIGINT, signal.SIGTERM, *((HANGUP,) if HANGUP else ()))
WORDS = {
    signal.SIGINT: "error: stopped by the user; no file is left half-written",
    signal.SIGTERM: "error: ended by a signal (SIGTERM); no file is left half-written",
    HANGUP: "error: the terminal was closed (SIGHUP); no file is left half-written",
}
# Files of the compiler, which calls back while it loads what it has compiled.
COMPILER = f"{os.sep}llvmlite{os.sep}"
# Seconds after which a signal that came at a bad moment is sent again.
AGAIN_SECONDS = 0.002


class Signals:
    """The three signals in a block: raised, so that all that tidies up is run; earlier handlers come back at its end.

    Never raised inside an import, a finaliser, a weak reference's callback or one of the compiler's (llvmlite):
    compiled modules swallow an exception there or take it for damage, and Python prints it and goes on. There the
    signal is sent again a moment later.
    """

    def __init__(self) -> None:
        self.number = 0  # The last signal; 0 for none
        self._before: dict[int, Any] = {}
        self._outside: FrameType | None = None

    def __enter__(self) -> Self:
        self._outside = sys._getframe(1)
        self._before = listen(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._outside = None
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Raise what a signal stands for."""
        self.number = number
        if not self._put_off(number, frame):
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(SIGNAL_CODE + number)

    def _put_off(self, number: int, frame: FrameType | None) -> bool:
        """Whether this is a bad moment to raise anything; then the signal will come again."""
        while frame is not None and frame is not self._outside:
            code = frame.f_code
            if (
                code.co_name == "__del__"
                or code.co_filename.startswith("<frozen importlib")
                or code.co_filename.endswith(("weakref.py", "_weakrefset.py"))
                or COMPILER in code.co_filename
            ):
                # Handlers run in the main thread: the one to wake.
                _thread.start_new_thread(_send_again, (number, _thread.get_ident()))
                return True
            frame = frame.f_back
        return False


class PoliteSignals(Signals):
    """Once `polite` is set, the first signal is only noted, for the work to end at its next step; the second raises."""

    def __init__(self) -> None:
        super().__init__()
        self.polite = False

    def asked(self) -> bool:
        """Whether to end."""
        return self.number != 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal, raise at the next."""
        if self.polite and not self.number:
            self.number = number
            write("stopping: what is done is kept; once more to stop at once")
        elif not self._put_off(number, frame):
            write("stopped at once" if self.number else "stopped; nothing was written")
            self.number = number
            raise SystemExit(SIGNAL_CODE + number)


def listen(handler: Any) -> dict[int, Any]:
    """Have the three signals call a function, where Python and the caller allow it; the handlers of before."""
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


def leave_at_once(number: int, frame: FrameType | None) -> NoReturn:
    """Write the line of a signal and end the process, without tidying up."""
    say(number)
    os._exit(SIGNAL_CODE + number)


def leave(code: int) -> NoReturn:
    """End the process with what it has printed, and without Python's own tidying up."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            continue  # nobody reads it
    os._exit(code)


def say(number: int) -> None:
    """Write the one line of a signal to standard error."""
    write(WORDS[signal.Signals(number)])


def write(words: str) -> None:
    """Write a line to standard error."""
    try:
        # Not through a stream: the signal may have come in the middle of its write.
        os.write(2, f"dqreg: {words}\n".encode())
    except OSError:
        return  # nobody listens


def _send_again(number: int, main: int) -> None:
    time.sleep(AGAIN_SECONDS)
    if hasattr(signal, "pthread_kill"):
        # To that thread: this one may have come into being while the signal was blocked.
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)
