"""Rows on a Dask cluster: each is a task, and each task has its row registered in a process of its own.

A task hands its row to a `Worker`, as the pool of one machine does: a crash or a hang in a registration ends that
child, not the Dask worker. The tasks of a Dask worker that dies go to another one. Results come back to this process,
which alone writes.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import dataclasses
import itertools
import secrets
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

from dqreg.errors import DqregError, InputError
from dqreg.registration.batch.dask_client import connected, load_distributed, within
from dqreg.registration.batch.pool import POLL_SECONDS, Answer, Stop
from dqreg.registration.batch.row import Row, RowResult, Thumbnail, row_worker, run_isolated
from dqreg.registration.batch.worker import Worker

# A scheduler that does not say within these how many threads there are is gone.
SILENT_SECONDS = 15.0
# Seconds after which a child on a cluster ends by itself: its memory belongs to others again.
IDLE_SECONDS = 60.0
# Seconds that a cluster may be without any worker.
DESERTED_SECONDS = 60.0
# Ends of a process that another machine may not come to.
DEATHS = ("crashed", "memory")
CANCELLED = (asyncio.CancelledError, concurrent.futures.CancelledError)

# Children of this Dask worker: those that have nothing to do, and those at work with the batch that they work for.
_idle: list[Worker] = []
_busy: dict[Worker, str] = {}
_lock = threading.Lock()


def on_cluster(
    rows: Sequence[Row],
    address: str,
    *,
    threads: int = 1,
    timeout: float | None = None,
    thumbnail: Thumbnail | None = None,
    stop: Stop = lambda: False,
) -> Iterator[Answer]:
    """Register rows on the workers of a Dask cluster, which must see the files under the same paths."""
    if not rows:
        return
    with connected(address) as client:
        tasks = _RowTasks(client, address, rows, (threads, timeout, thumbnail))
        try:
            while tasks.left and not stop():
                yield from tasks.finished_rows(POLL_SECONDS)
            yield from tasks.finished_rows()
        finally:
            tasks.drop()


class _RowTasks:
    """Tasks on their way: as many as the cluster has threads, so that a worker's death touches few."""

    def __init__(self, client: Any, address: str, rows: Sequence[Row], order: tuple[Any, ...]) -> None:
        self._client, self._address, self._order = client, address, order
        self._token = secrets.token_hex(8)
        self._numbers = itertools.count()
        self._waiting = list(reversed(rows))
        self._running: dict[Any, Row] = {}
        self._last_seen = time.monotonic()
        self._places: tuple[str, ...] = ()
        # Where a row's process died the first time.
        self._died: dict[str, str] = {}

    @property
    def left(self) -> int:
        return len(self._waiting) + len(self._running)

    def finished_rows(self, seconds: float = 0.0) -> Iterator[Answer]:
        """Rows that get done within some seconds, with new ones started in the place of others."""
        if seconds:
            self._start()
            self._wait(seconds)
        for future in [future for future in self._running if future.done()]:
            row = self._running.pop(future)
            if future.status in ("cancelled", "lost"):
                self._waiting.append(row)  # the scheduler forgot it; nothing came of it yet
                continue
            done, place = _done(future)
            future.release()
            first = self._died.get(row.name)
            if done.status not in DEATHS:
                yield row, done
            elif first is None:
                # Of the machine, perhaps: once more, elsewhere.
                self._died[row.name] = place
                self._waiting.append(row)
            else:
                places = " and ".join(dict.fromkeys(filter(None, (first, place))))
                yield row, dataclasses.replace(done, message=f"{done.message} (tried twice, on {places})")

    def _start(self) -> None:
        for _ in range(min(len(self._waiting), self._slots() - len(self._running))):
            row = self._waiting.pop()
            key = f"dqreg-{self._token}-{next(self._numbers)}"
            others = [each for each in self._places if each != self._died[row.name]] if row.name in self._died else []
            where: dict[str, Any] = {"workers": others, "allow_other_workers": True} if others else {}
            future = self._client.submit(do_row, row, self._token, *self._order, pure=False, key=key, **where)
            self._running[future] = row

    def _wait(self, seconds: float) -> None:
        from distributed import wait

        if not self._running:
            time.sleep(seconds)
            return
        with self._client.as_current(), contextlib.suppress(TimeoutError, *CANCELLED):
            wait(list(self._running), timeout=seconds, return_when="FIRST_COMPLETED")  # type: ignore[no-untyped-call]

    def _slots(self) -> int:
        try:
            if self._client.status != "running":
                raise OSError(self._client.status)
            threads = within(SILENT_SECONDS, self._client.nthreads)
            self._places, count = tuple(threads), int(sum(threads.values()))
        except OSError as error:
            raise InputError(
                f"the Dask scheduler at {self._address} is gone; rows done so far are kept: resume with --resume"
            ) from error
        now = time.monotonic()
        self._last_seen = now if count else self._last_seen
        if now - self._last_seen > DESERTED_SECONDS:
            raise InputError(
                f"the Dask cluster at {self._address} has no workers any more; rows done so far are kept: resume with "
                f"--resume"
            )
        return count

    def drop(self) -> None:
        """Give up what is flying, and end the children that work on it."""
        if not self._running:
            return
        with contextlib.suppress(Exception, *CANCELLED):
            within(5.0, lambda: self._client.cancel(list(self._running), force=True))
            within(5.0, lambda: self._client.run(end_children, self._token))


def _done(future: Any) -> tuple[RowResult, str]:
    """What came of a row, and the worker that it came from."""
    if future.status == "finished":
        found: tuple[RowResult, str] = future.result()
        return found
    error = future.exception()
    if isinstance(error, DqregError):
        raise error
    if type(error).__name__ == "KilledWorker":
        # Dask tries a task on several workers before it takes their deaths for its fault.
        return RowResult("error", "every Dask worker that took it died"), ""
    return RowResult("error", f"{type(error).__name__}: {error}"), ""


def do_row(
    row: Row, batch: str, threads: int, timeout: float | None, thumbnail: Thumbnail | None
) -> tuple[RowResult, str]:
    """Have a row done by a child of this Dask worker, within its memory; runs there."""
    here = load_distributed().get_worker()
    limit = here.memory_manager.memory_limit
    memory = None if not limit else limit / max(1, here.state.nthreads)
    with _lock:
        child = _idle.pop() if _idle else row_worker(threads, IDLE_SECONDS)
        _busy[child] = batch
    try:
        return run_isolated(child, row, timeout, thumbnail, memory), str(here.address)
    finally:
        with _lock:
            del _busy[child]
            if not child.closed:
                _idle.append(child)


def end_children(batch: str) -> None:
    """End the children of this Dask worker that work for a batch; runs there."""
    with _lock:
        children = [child for child, owner in _busy.items() if owner == batch]
    for child in children:
        child.close()
