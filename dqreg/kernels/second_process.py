"""A second process that compiles kernels from the other end, so that the first use takes about half as long.

Only programs of our own ask for it: `sys.executable` of a program that calls the library need not be Python.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys

# What it does: each process reads what the other has compiled, until both meet.
CODE = "from dqreg.kernels.compile_all import compile_all; compile_all(backwards=True)"

# The process that may start one, and has not yet.
_asking: int | None = None


def allow() -> None:
    """Let this process start a second one at the first kernel that is not kept; a fork of it may not."""
    global _asking  # noqa: PLW0603
    _asking = os.getpid()


def start_if_allowed() -> None:
    """Start it, once, where this process may; it ends by itself when all is compiled."""
    global _asking  # noqa: PLW0603
    if _asking == os.getpid():
        # Numba makes millions of objects: those that are there already need not be looked through again and again.
        gc.freeze()
        start()
    _asking = None


def start() -> subprocess.Popen[bytes] | None:
    """The second process; None where there is no core for it."""
    # NumPy is not needed for `allow`, which every command calls.
    from dqreg.kernels.threads import thread_count

    if thread_count() < 2 or not sys.executable:
        return None
    none = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-c", CODE], stdin=none, stdout=none, stderr=none)
