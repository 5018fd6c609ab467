"""The environment of a comparison: machine, versions, and the time it will take."""

from __future__ import annotations

import contextlib
import datetime
import os
import platform
import subprocess
from collections.abc import Iterable
from pathlib import Path

from dqreg.files.code_identity import ALWAYS, installed_versions

# Every session names them, and whatever its engines need.
NAMED = (*ALWAYS, "open3d", "open3d-cpu")


def session(needs: Iterable[str], threads: int) -> dict[str, object]:
    """Date, machine, its load, versions and threads of the runs of one session."""
    return {
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": machine_line(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "commit": _commit(),
        "versions": installed_versions((*NAMED, *needs)),
        "threads": threads,
    }


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


def machine_memory() -> float:
    """Bytes of memory of the machine.

    >>> machine_memory() > 0.0
    True
    """
    import psutil

    return float(psutil.virtual_memory().total)


def _commit() -> str | None:
    """Commit of the sources, where they stand in a repository."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        command = ["git", "-C", os.fspath(root), "rev-parse", "HEAD"]
        return subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=True).stdout.strip()
    return None


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
