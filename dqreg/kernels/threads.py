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
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar, copy_context
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from dqreg._arrays import FloatArray

T = TypeVar("T")

# Once an array of so many bytes was given back, memory of smaller ones stays with the process, twice as much at most:
# glibc's own rule, see mallopt(3). Else two scans of a LiDAR took 800 pages anew at each call, a twentieth of its time.
KEPT_BYTES = 1 << 24
np.zeros(KEPT_BYTES, dtype=np.uint8)

# Rows a range: some milliseconds at most, and far more than handing it over costs.
CHUNK = 2048
# Ranges of a thread where their length is free: few, as each costs a call, and more than one, so that all end together.
RANGES_PER_THREAD = 4

# Seconds of a caller's work that handing ranges over, and waiting for their end, take.
HANDED_OVER = 2e-4

NEVER = float("inf")
# Until when what is computed may take, by `time.perf_counter`.
_deadline: ContextVar[float] = ContextVar("deadline", default=NEVER)

_lock = threading.Lock()
# By process, and by whether they are for stages: a stage may wait for ranges, and ranges wait for nothing.
_pools: dict[tuple[int, bool], ThreadPoolExecutor] = {}
# Whether this thread is at a range.
_here = threading.local()
# Stages that run beside their callers: each has a core.
_running: list[None] = []


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
    deadline = _deadline.get()
    if deadline < NEVER and time.perf_counter() > deadline:
        raise TimeUpError


def deadline_here() -> float:
    """The deadline that `until` has set; inf for none."""
    return _deadline.get()


def time_left() -> float:
    """Seconds up to the deadline, 0 once it has passed; inf without one."""
    deadline = _deadline.get()
    return max(deadline - time.perf_counter(), 0.0) if deadline < NEVER else NEVER


def thread_count() -> int:
    """Threads to compute with: the cores this process may use, or fewer where OMP_NUM_THREADS says so."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return max(min(int(asked), cores), 1) if asked.isdigit() else cores


def even_chunk(total: int, least: int) -> int:
    """Rows a range for kernels whose rows know nothing of each other, so that any length gives the same bits."""
    # What even two threads leave the least of, nobody has to be asked about.
    few = total <= 2 * RANGES_PER_THREAD * least
    return min(least, CHUNK) if few else min(max(-(-total // (RANGES_PER_THREAD * thread_count())), least), CHUNK)


def over_chunks(
    kernel: Callable[..., Any],
    total: int,
    *arguments: Any,
    chunk: int = CHUNK,
    fewest: int = 2,
    may_be_quick: bool = False,
) -> None:
    """Call ``kernel(first, last, *arguments)`` for all rows, a range of ``chunk`` rows at a time, on all threads.

    Within a range the same is done on its own thread: the others have ranges of their own. Fewer whole ranges than the
    fewest, which take no longer than to hand them over, are done by the caller; and all of what may be quick, where the
    first range says so.
    """
    ask_clock()
    if total <= chunk:
        kernel(0, total, *arguments)
        return
    starts, given = deque(range(0, total, chunk)), [(kernel, arguments)]

    def work() -> None:
        was_within, _here.within = getattr(_here, "within", False), True
        try:
            while True:
                try:
                    first = starts.popleft()
                except IndexError:
                    return
                # Helpers know of no deadline: they stop when the caller does.
                ask_clock()
                call, columns = given[0]
                call(first, min(first + chunk, total), *columns)
        finally:
            _here.within = was_within

    if getattr(_here, "within", False):
        work()
        return

    if may_be_quick:
        began = time.perf_counter()
        kernel(starts.popleft(), chunk, *arguments)
        if len(starts) * (time.perf_counter() - began) < HANDED_OVER:
            work()
            return

    # To hand over a rest that is no whole range would cost more than it saves.
    whole = total // chunk
    asked = [_submit(work) for _ in range(min(thread_count() - len(_running), whole) - 1 if whole >= fewest else 0)]
    helpers = [helper for helper in asked if helper is not None]
    try:
        work()
    finally:
        # After an error or an interrupt the helpers stop at the end of their range.
        starts.clear()
        started = [helper for helper in helpers if not helper.cancel()]
    for helper in started:
        helper.result()
    # One that was not begun stays in the queue of a pool whose threads no core is free for: the arrays shall not.
    given.clear()


def as_plain(values: FloatArray) -> FloatArray:
    """The array as kernels take it: for another layout, or one that is read only, each would be compiled once more."""
    if type(values) is np.ndarray and values.dtype == np.float64 and values.flags.carray:
        return values
    # A copy in any case: `np.require` would ask about it for longer than these few numbers take.
    return np.array(values, dtype=np.float64, order="C")


@contextlib.contextmanager
def running_beside() -> Iterator[None]:
    """What is computed inside has a core for itself, beside its caller: ranges of others leave it that."""
    _running.append(None)
    try:
        yield
    finally:
        _running.pop()


def aside(kernel: Callable[..., Any], *arguments: Any) -> Any:
    """Result of a kernel that takes long, computed on another thread: an interrupt of this one is seen at once."""
    # Others than the main thread see none.
    future = _submit(kernel, *arguments) if threading.current_thread() is threading.main_thread() else None
    return kernel(*arguments) if future is None else future.result()


class Later(Generic[T]):
    """What is computed beside the caller where a core is idle, or by the caller when it asks; the same either way.

    It knows the deadline that the caller had when it was begun. It may wait for one that was begun before it, and for
    none that was begun after.
    """

    def __init__(self, call: Callable[[], T], *, beside: bool = True) -> None:
        self._call, self._process = call, os.getpid()
        beside = beside and thread_count() > 1
        self._future = _submit(copy_context().run, self._beside, stage=True) if beside else None

    @property
    def is_beside(self) -> bool:
        """Whether another thread may be at it."""
        return self._future is not None

    @property
    def is_begun(self) -> bool:
        """Whether another thread is at it, or has been; in a child of a fork there is none."""
        future = self._future
        return future is not None and (future.done() or (future.running() and self._process == os.getpid()))

    def result(self) -> T:
        """The result; what the call raises is raised here."""
        if self._future is None or self._future.cancel():
            # Not here alone: an error, the deadline say, is not the result of another call.
            found = self._call()
            self._future = Future()
            self._future.set_result(found)
        known: T = self._future.result()
        return known

    def _beside(self) -> T:
        with running_beside():
            found = self._call()
        # What holds this may be what it was made of: both go without a look for cycles.
        del self._call
        return found


class unlocked_property(cached_property[T]):  # noqa: N801
    """`cached_property` without the lock that Python 3.11 has for all objects of a class: threads make the same."""

    def __init__(self, make: Callable[[Any], T]) -> None:
        super().__init__(make)
        self.lock = contextlib.nullcontext()


def all_results(begun: Sequence[Later[T]]) -> list[T]:
    """Results of what was begun, in its order: the caller works from the end on, others are at the beginning."""
    for later in reversed(begun):
        later.result()
    return [later.result() for later in begun]


def _submit(call: Callable[..., Any], *arguments: Any, stage: bool = False) -> Future[Any] | None:
    # At the end of the interpreter pools take nothing any more; what runs there, in atexit say, does without.
    try:
        return _pool(stage).submit(call, *arguments)
    except RuntimeError:
        return None


def _pool(stage: bool) -> ThreadPoolExecutor:
    key = os.getpid(), stage
    with _lock:
        if key not in _pools:
            # One core is the caller's, who works as well.
            threads = max((os.cpu_count() or 1) - stage, 1)
            _pools[key] = ThreadPoolExecutor(threads, thread_name_prefix="dqreg")
        return _pools[key]


def _after_fork() -> None:
    # Another thread of the parent may have held the lock; its pool has no threads here.
    global _lock  # noqa: PLW0603
    _lock = threading.Lock()
    _pools.clear()
    _running.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
