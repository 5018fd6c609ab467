"""What a comparison ran on: one line that stands under every table."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Iterable
from pathlib import Path

from dqreg.compare.worker import machine_memory

ALWAYS = ("dqreg", "numpy", "scipy", "open3d", "open3d-cpu")


def session(needs: Iterable[str], threads: int) -> dict[str, object]:
    """What makes the runs of one session."""
    return {"machine": machine_line(), "versions": versions(needs), "threads": threads}


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


def versions(names: Iterable[str]) -> dict[str, str]:
    """Versions of what is installed."""
    found = {}
    for name in dict.fromkeys((*ALWAYS, *names)):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
