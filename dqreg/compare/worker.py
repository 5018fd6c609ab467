"""A process of its own for the engines: a crash, a hang or a memory blow-up costs one run, not the comparison."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from dqreg.compare.attempt import Outcome, call, pack, warm_up
from dqreg.compare.engines.protocol import Task
from dqreg.compare.entrants import Entrant
from dqreg.registration.batch.child_start import safely_started

# Starting Python is not the engine's doing, nor is the loading of libraries in its first run, which is not timed.
START_SECONDS, WARM_SECONDS = 120.0, 20.0
POLL_SECONDS = 0.1
MEMORY_SHARE = 0.75


class Worker:
    """A spawned process that runs engines one after another, and is replaced when it dies.

    >>> Worker(threads=1).close()
    """

    def __init__(self, threads: int, memory_limit: float | None = None) -> None:
        self._threads = threads
        self._memory_limit = memory_limit if memory_limit is not None else MEMORY_SHARE * machine_memory()
        self._process: Any = None
        self._link: Connection | None = None
        self._log = tempfile.TemporaryDirectory(prefix="dqreg-compare-")

    def attempts(self, entrant: Entrant, task: Task, repeats: int, timeout: float) -> Iterator[Outcome]:
        """Run an engine, and again."""
        packed = pack(entrant, task)
        try:
            link = self._ready()
            link.send(("warm up", entrant.name, packed))
            self._answer(link, timeout + WARM_SECONDS)
            for _ in range(repeats):
                link.send(("run", entrant.name, packed))
                outcome: Outcome = self._answer(link, timeout)
                yield outcome
                if outcome.status != "ran":
                    return
        except TimeoutError:  # before OSError, which it is one of
            self._end()
            yield Outcome("timeout", f"no answer within {timeout:g} s", wall_seconds=timeout)
        except (EOFError, OSError):
            last_words = self._last_words()
            self._end()
            yield Outcome("crashed", last_words)
        except MemoryError as error:
            self._end()
            yield Outcome("memory", str(error))

    def close(self) -> None:
        """End the process and remove its log."""
        self._end()
        self._log.cleanup()

    def _ready(self) -> Connection:
        if self._process is not None and self._process.is_alive() and self._link is not None:
            return self._link
        self._end()
        context = multiprocessing.get_context("spawn")
        self._link, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, self._log.name), daemon=True)
        with safely_started(self._threads):
            self._process.start()
        theirs.close()
        self._answer(self._link, START_SECONDS)
        return self._link

    def _answer(self, link: Connection, timeout: float) -> Any:
        deadline = time.monotonic() + timeout
        while not link.poll(POLL_SECONDS):
            if time.monotonic() > deadline:
                raise TimeoutError
            used = resident_memory(self._process.pid)
            if used > self._memory_limit:
                raise MemoryError(f"ended at {used / 2**30:.1f} GiB, limit {self._memory_limit / 2**30:.1f} GiB")
        return link.recv()

    def _last_words(self) -> str:
        self._process.join(5.0)
        code = self._process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        with contextlib.suppress(OSError):
            lines = (Path(self._log.name) / "log").read_text(errors="replace").strip().splitlines()
            if lines:
                return f"the process died ({how}): {lines[-1][:200]}"
        return f"the process died ({how})"

    def _end(self) -> None:
        if self._link is not None:
            self._link.close()
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._process = self._link = None


def serve(link: Connection, log_folder: str) -> None:
    """Do what the parent says until it hangs up; runs in the worker process."""
    with (Path(log_folder) / "log").open("wb") as log:
        for stream in (1, 2):
            os.dup2(log.fileno(), stream)
    warm: set[str] = set()
    link.send("ready")
    while True:
        try:
            order, name, packed = link.recv()
        except EOFError:
            return
        if order == "run":
            link.send(call(packed))
            continue
        if name not in warm:
            warm_up(packed)
            warm.add(name)
        link.send("warm")


def resident_memory(pid: int | None) -> float:
    """Memory of a process.

    >>> resident_memory(None)
    0.0
    """
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return float(pages * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0


def machine_memory() -> float:
    """Memory of the machine.

    >>> machine_memory() > 0.0
    True
    """
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, AttributeError):
        return float("inf")
