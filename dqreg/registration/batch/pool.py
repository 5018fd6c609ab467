"""Rows on this machine: a few worker processes, each with one row at a time."""

from __future__ import annotations

import os
import queue
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from dqreg.errors import InputError
from dqreg.registration.batch.row import TARGETS_KEPT, Row, RowResult, Thumbnail, row_worker, run_isolated
from dqreg.registration.batch.worker import Worker

POLL_SECONDS = 0.1

Answer = tuple[Row, RowResult]
Stop = Callable[[], bool]


def on_this_machine(
    rows: Sequence[Row],
    *,
    workers: int | None = None,
    threads: int | None = None,
    timeout: float | None = None,
    thumbnail: Thumbnail | None = None,
    stop: Stop = lambda: False,
) -> Iterator[Answer]:
    """Register rows in worker processes of this machine."""
    cores = os.cpu_count() or 1
    workers = cores if workers is None else workers
    if workers < 1:
        raise InputError(f"workers must be 1 or more; got {workers}")
    workers = min(workers, len(rows))
    shared = max(1, cores // max(workers, 1)) if threads is None else threads
    pool = _Pool(rows, [row_worker(shared) for _ in range(workers)], timeout, thumbnail)
    try:
        yield from pool.answers(stop)
    finally:
        pool.close()


class Backlog:
    """Rows that wait; a worker gets those of a target that it has prepared first."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._by_target: OrderedDict[Path, deque[Row]] = OrderedDict()
        for row in rows:
            self._by_target.setdefault(row.target, deque()).append(row)
        self._lock = threading.Lock()

    def take(self, prepared: Sequence[Path]) -> Row | None:
        """The next row for a worker that has these targets; None if there is none left."""
        with self._lock:
            target = next((each for each in prepared if each in self._by_target), None)
            if target is None:
                target = next(iter(self._by_target), None)
                if target is None:
                    return None
                # The next worker without a target starts with another one, where there is one.
                self._by_target.move_to_end(target)
            row = self._by_target[target].popleft()
            if not self._by_target[target]:
                del self._by_target[target]
            return row


class _Pool:
    """One thread a worker process: it waits for the process, and does nothing else."""

    def __init__(
        self, rows: Sequence[Row], workers: list[Worker], timeout: float | None, thumbnail: Thumbnail | None
    ) -> None:
        self._count = len(rows)
        self._backlog = Backlog(rows)
        self._workers = workers
        self._timeout, self._thumbnail = timeout, thumbnail
        self._answers: queue.SimpleQueue[Answer | Exception] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._threads = [threading.Thread(target=self._serve_rows, args=(worker,), daemon=True) for worker in workers]

    def answers(self, stop: Stop) -> Iterator[Answer]:
        if stop():
            return
        for thread in self._threads:
            thread.start()
        given = 0
        while given < self._count and not stop():
            try:
                answer = self._answers.get(timeout=POLL_SECONDS)
            except queue.Empty:
                continue
            if isinstance(answer, Exception):
                raise answer
            given += 1
            yield answer
        self.close()
        # Rows that got done while the others were being dropped.
        while not self._answers.empty():
            answer = self._answers.get()
            if not isinstance(answer, Exception):
                yield answer

    def close(self) -> None:
        self._stopping.set()
        for worker in self._workers:
            worker.close()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()

    def _serve_rows(self, worker: Worker) -> None:
        prepared: deque[Path] = deque(maxlen=TARGETS_KEPT)
        try:
            while not self._stopping.is_set() and (row := self._backlog.take(prepared)) is not None:
                done = run_isolated(worker, row, self._timeout, self._thumbnail)
                if self._stopping.is_set() and done.status != "ran":
                    return  # ended by us
                self._answers.put((row, done))
                if done.status in ("crashed", "timeout"):
                    prepared.clear()
                elif row.target not in prepared:
                    prepared.append(row.target)
        except Exception as error:
            self._answers.put(error)
        finally:
            worker.close()
