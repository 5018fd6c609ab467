"""What a process uses, seen from outside: CPU time and memory."""

from __future__ import annotations

import contextlib


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
