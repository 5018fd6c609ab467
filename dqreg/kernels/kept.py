"""What is made once and kept for those who ask later, by whoever asks first."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import nullcontext
from typing import Generic, TypeVar

from dqreg.kernels.threads import NEVER, TimeUpError, running_beside, thread_count, time_left, until

T = TypeVar("T")


class Kept(Generic[T]):
    """A value that is made to the end, whatever the time; who has a deadline waits no longer than that.

    One that is not for others ends with the time of the caller who makes it, and is made anew by the next.
    """

    def __init__(self, make: Callable[[], T], *, for_others: bool = True) -> None:
        self._make, self._for_others = make, for_others
        self._lock = threading.Lock()
        self._made: tuple[int, Future[T]] | None = None

    def begin(self) -> None:
        """Make it beside the caller where there is a core for it, else now."""
        made, is_new = self._begun()
        if is_new and thread_count() > 1:
            threading.Thread(target=self._fill_beside, args=(made,)).start()
        elif is_new:
            self._fill(made)

    def result(self) -> T:
        """The value; `TimeUpError` where it is not there in time."""
        left = time_left()
        made, is_new = self._begun()
        if is_new and (left == NEVER or not self._for_others):
            self._fill(made)
        elif is_new:
            # A thread of its own: the cores of the caller, who waits, are free for it.
            threading.Thread(target=self._fill, args=(made,), daemon=True).start()
        wait([made], None if left == NEVER else left)
        if not made.done():
            raise TimeUpError
        return made.result()

    def _begun(self) -> tuple[Future[T], bool]:
        """Where the value is or will be, and whether it is for the caller to make."""
        process = os.getpid()
        with self._lock:
            # A thread that was at it in the parent of a fork is not here.
            is_new = self._made is None or (self._made[0] != process and not self._made[1].done())
            made = Future() if self._made is None or is_new else self._made[1]
            self._made = process, made
        return made, is_new

    def _fill_beside(self, made: Future[T]) -> None:
        with running_beside():
            self._fill(made)

    def _fill(self, made: Future[T]) -> None:
        try:
            with until(NEVER) if self._for_others else nullcontext():
                found = self._make()
        except BaseException as error:
            # Whoever asks next makes it anew.
            self._made = None
            made.set_exception(error)
        else:
            made.set_result(found)
