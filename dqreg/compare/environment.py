"""The environment of a comparison: machine, versions, and the time it will take."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
from collections.abc import Iterable
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
        f"{memory / 2**30:.0f} GiB",
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
    """Bytes of memory of the machine.

    >>> machine_memory() > 0.0
    True
    """
    import psutil

    return float(psutil.virtual_memory().total)


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
