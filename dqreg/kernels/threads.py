"""Kernels on threads: fixed ranges of rows, so that the bits are the same for any number of threads.

The pool belongs to the process that made it: a child of a fork makes its own. The caller works as well, so a pool that
is busy with other callers delays nobody, and an interrupt is seen after the range at hand. So is a deadline, where the
caller has set one.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray

# Rows a range: some milliseconds at most, and far more than handing it over costs.
CHUNK = 2048

# Until when what is computed may take, by `time.perf_counter`.
_deadline: ContextVar[float] = ContextVar("deadline", default=np.inf)

_lock = threading.Lock()
_pools: dict[int, ThreadPoolExecutor] = {}


class TimeUpError(Exception):
    """The deadline of `until` has passed; whoever sets one catches it."""


@contextlib.contextmanager
def until(deadline: float) -> Iterator[None]:
    """Raise `TimeUpError` from what is computed inside once `time.perf_counter` has passed a deadline; inf never."""
    token = _deadline.set(deadline)
    try:
        yield
    finally:
        _deadline.reset(token)


def ask_clock() -> None:
    """Raise where the deadline has passed."""
    if time.perf_counter() > _deadline.get():
        raise TimeUpError


def thread_count() -> int:
    """Threads to compute with: the cores this process may use, or fewer where OMP_NUM_THREADS says so."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return max(min(int(asked), cores), 1) if asked.isdigit() else cores


def over_chunks(kernel: Callable[..., Any], total: int, *arguments: Any, chunk: int = CHUNK) -> None:
    """Call ``kernel(first, last, *arguments)`` for all rows, a range of ``chunk`` rows at a time, on all threads."""
    ask_clock()
    if total <= chunk:
        kernel(0, total, *arguments)
        return
    starts = deque(range(0, total, chunk))

    def work() -> None:
        while True:
            try:
                first = starts.popleft()
            except IndexError:
                return
            # Helpers know of no deadline: they stop when the caller does.
            ask_clock()
            kernel(first, min(first + chunk, total), *arguments)

    asked = [_submit(work) for _ in range(min(thread_count(), len(starts)) - 1)]
    helpers = [helper for helper in asked if helper is not None]
    try:
        work()
    finally:
        # After an error or an interrupt the helpers stop at the end of their range.
        starts.clear()
        started = [helper for helper in helpers if not helper.cancel()]
    for helper in started:
        helper.result()


def as_plain(values: FloatArray) -> FloatArray:
    """The array as kernels take it: for another layout, or one that is read only, each would be compiled once more."""
    if type(values) is np.ndarray and values.dtype == np.float64 and values.flags.carray:
        return values
    plain: FloatArray = np.require(values, np.float64, ["C", "A", "W", "E"])
    return plain


def aside(kernel: Callable[..., Any], *arguments: Any) -> Any:
    """Result of a kernel that takes long, computed on another thread: an interrupt of this one is seen at once."""
    future = _submit(kernel, *arguments)
    return kernel(*arguments) if future is None else future.result()


def _submit(call: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
    # At the end of the interpreter pools take nothing any more; what runs there, in atexit say, does without.
    try:
        return _pool().submit(call, *arguments)
    except RuntimeError:
        return None


def _pool() -> ThreadPoolExecutor:
    process = os.getpid()
    with _lock:
        if process not in _pools:
            _pools[process] = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="dqreg")
        return _pools[process]


def _after_fork() -> None:
    # Another thread of the parent may have held the lock; its pool has no threads here.
    global _lock  # noqa: PLW0603
    _lock = threading.Lock()
    _pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
