"""A process seen from outside: its time, its memory and that of what it has started, and its end."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import signal
import subprocess
import threading
import time
from typing import Any, Literal

# How often it is looked at whether the process lives, and its memory.
POLL_SECONDS = 0.1
# Polls from one look at what it has started to the next, for which all processes of the machine are listed.
CHILDREN_EVERY = 10


@dataclasses.dataclass(frozen=True)
class Failure:
    """Why a task has no result."""

    kind: Literal["crashed", "timeout", "memory"]
    message: str  # One line for people


class Watch:
    """Ends a process that takes too long or too much memory, so that reading from it ends as well."""

    def __init__(self, timeout: float | None, memory: float | None, cpu: float | None = None) -> None:
        self._timeout, self._memory, self._cpu = timeout, memory, cpu
        self.failure: Failure | None = None

    @contextlib.contextmanager
    def over(self, process: subprocess.Popen[bytes]) -> Any:
        """Watch a process during a block."""
        if self._timeout is None and self._memory is None and self._cpu is None:
            yield
            return
        done = threading.Event()
        thread = threading.Thread(target=self._run, args=(process, done), daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    def _run(self, process: subprocess.Popen[bytes], done: threading.Event) -> None:
        end = None if self._timeout is None else time.monotonic() + self._timeout
        begun = 0.0 if self._cpu is None else cpu_seconds(process.pid)
        for poll in itertools.count():
            if done.wait(POLL_SECONDS if end is None else min(POLL_SECONDS, max(0.0, end - time.monotonic()))):
                return
            counted = self._memory is not None
            used = resident_memory(process.pid, children=poll % CHILDREN_EVERY == 0) if counted else 0.0
            if self._memory is not None and used > self._memory:
                words = f"ended at {used / 2**30:.1f} GiB, limit {self._memory / 2**30:.1f} GiB"
                self.failure = Failure("memory", words)
            elif self._cpu is not None and cpu_seconds(process.pid) - begun > self._cpu:
                self.failure = Failure("timeout", f"no answer within {self._cpu:g} s of CPU time")
            elif end is not None and time.monotonic() >= end:
                self.failure = Failure("timeout", f"no answer within {self._timeout:g} s")
            if self.failure is not None or process.poll() is not None:
                break
        kill(process)


def kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it has forked: as long as a child lives, the pipe to it stays open."""
    if os.name != "nt":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()


def cpu_seconds(pid: int) -> float:
    """CPU time that a process has taken, whatever else the machine does; 0 of one that has ended."""
    import psutil

    try:
        taken = psutil.Process(pid).cpu_times()
    except (psutil.Error, ValueError):
        return 0.0
    return float(taken.user + taken.system)


def resident_memory(pid: int, *, children: bool = False) -> float:
    """Bytes of memory that a process holds, and what it has started too; 0 of one that has ended."""
    import psutil

    found = 0.0
    with contextlib.suppress(psutil.Error, ValueError):
        process = psutil.Process(pid)
        for each in (process, *(process.children(recursive=True) if children else ())):
            with contextlib.suppress(psutil.Error):
                found += each.memory_info().rss
    return found
