"""What is made once and kept for those who ask later, by whoever asks first."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Generic, TypeVar

from dqreg.kernels.threads import NEVER, TimeUpError, time_left, until

T = TypeVar("T")


class Kept(Generic[T]):
    """A value that is made to the end, whatever the time; who has a deadline waits no longer than that."""

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._lock = threading.Lock()
        self._made: tuple[int, Future[T]] | None = None

    def result(self) -> T:
        """The value; `TimeUpError` where it is not there in time."""
        left, process = time_left(), os.getpid()
        with self._lock:
            made = self._begun(process)
            is_new = made is None
            made = Future() if made is None else made
            self._made = process, made
        if is_new and left == NEVER:
            self._fill(made)
        elif is_new:
            # A thread of its own: the cores of the caller, who waits, are free for it.
            threading.Thread(target=self._fill, args=(made,), daemon=True).start()
        wait([made], None if left == NEVER else left)
        if not made.done():
            raise TimeUpError
        return made.result()

    def _begun(self, process: int) -> Future[T] | None:
        # A thread that was at it in the parent of a fork is not here.
        if self._made is None or (self._made[0] != process and not self._made[1].done()):
            return None
        return self._made[1]

    def _fill(self, made: Future[T]) -> None:
        try:
            with until(NEVER):
                found = self._make()
        except BaseException as error:
            # Whoever asks next makes it anew.
            self._made = None
            made.set_exception(error)
        else:
            made.set_result(found)
