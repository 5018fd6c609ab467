"""What a library might do to a worker process, by the name of the scan; sent as the thumbnail function."""

from __future__ import annotations

import os
import time

from dqreg.errors import MissingDependencyError


def thumbnail(result):
    name = os.path.basename(result.settings["source"])  # noqa: PTH119
    if "crash" in name:
        os.write(2, b"out of cheese\n")
        os.abort()
    if "hang" in name:
        time.sleep(600.0)
    if "raise" in name:
        raise RuntimeError("no luck")
    os.write(1, b"libraries print where answers go\n")
    return b"picture"


def behave(kind):
    """A task of a worker process, and its process number where it ends well."""
    if kind == "hang":
        time.sleep(600.0)
    if kind == "speak":
        os.write(1, b"all is well\n")
    if kind == "leave":
        os._exit(3)
    if kind == "raise":
        raise LookupError("nobody home")
    if kind == "leave a child" and os.fork():
        os._exit(3)
    elif kind == "leave a child":
        time.sleep(600.0)
    if kind == "a greedy child":
        if os.fork() == 0:
            hoard = b"x" * 800_000_000
            time.sleep(600.0 + len(hoard) / 1e12)
        os.wait()
    if kind == "answer twice":
        child = os.fork()
        if child:
            os.waitpid(child, 0)
        return "child" if child == 0 else "parent"
    if kind == "threads":
        from dqreg._open3d import load_open3d
        from dqreg.kernels.threads import thread_count

        return load_open3d().utility.get_max_threads(), thread_count()
    if kind == "greedy":
        hoard = []
        while True:
            hoard.append(b"x" * 10_000_000)
            time.sleep(0.005)
    if kind == "wait":
        time.sleep(0.5)
        return 0.5
    if kind == "work":
        while True:
            pass
    return os.getpid()


def refuse():
    raise MissingDependencyError("no such library")
