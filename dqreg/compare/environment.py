"""The environment of a comparison: machine, versions, and the time it will take."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
from collections.abc import Hashable, Iterable
from pathlib import Path

ALWAYS = ("dqreg", "numpy", "scipy", "open3d", "open3d-cpu")


def session(needs: Iterable[str], threads: int) -> dict[str, object]:
    """Machine, versions and threads of the runs of one session."""
    return {"machine": machine_line(), "versions": installed_versions((*ALWAYS, *needs)), "threads": threads}


def machine_line() -> str:
    """Processor, cores, memory, system and Python in one line.

    >>> "Python" in machine_line()
    True
    """
    memory = machine_memory()
    words = [
        _processor(),
        f"{os.cpu_count() or 1} cores",
        f"{memory / 2**30:.0f} GiB" if memory < float("inf") else "",
        f"{platform.system()} {platform.release()}",
        f"Python {platform.python_version()}",
    ]
    return ", ".join(word for word in words if word)


def installed_versions(distributions: Iterable[str]) -> dict[str, str]:
    """Versions of those distributions that are installed."""
    found = {}
    for name in dict.fromkeys(distributions):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def machine_memory() -> float:
    """Bytes of memory of the machine; infinite where the system does not tell.

    >>> machine_memory() > 0.0
    True
    """
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, AttributeError):
        return float("inf")


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


class TimeLeft:
    """Estimate of the time that is left.

    Engines differ a thousandfold in speed, so each has its own rate; one that has not run yet gets the mean.

    >>> left = TimeLeft([("a", 1.0), ("a", 1.0), ("b", 2.0)])
    >>> left.done("a", 1.0, seconds=3.0)
    >>> left.seconds
    9.0
    """

    def __init__(self, jobs: Iterable[tuple[Hashable, float]]) -> None:
        self._left: dict[Hashable, float] = {}
        self._worked: dict[Hashable, float] = {}
        self._spent: dict[Hashable, float] = {}
        for engine, work in jobs:
            self._left[engine] = self._left.get(engine, 0.0) + work

    def done(self, engine: Hashable, work: float, seconds: float) -> None:
        """Count a job as done."""
        self._left[engine] = self._left.get(engine, 0.0) - work
        if seconds > 0.0:
            self._worked[engine] = self._worked.get(engine, 0.0) + work
            self._spent[engine] = self._spent.get(engine, 0.0) + seconds

    @property
    def seconds(self) -> float:
        """Seconds that the remaining jobs will take; NaN before the first is done."""
        worked = sum(self._worked.values())
        if not worked:
            return float("nan")
        mean = sum(self._spent.values()) / worked
        rates = {engine: self._spent[engine] / work for engine, work in self._worked.items() if work}
        return sum(max(0.0, left) * rates.get(engine, mean) for engine, left in self._left.items())
