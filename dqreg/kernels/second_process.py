"""A second process that compiles kernels from the other end, so that the first use takes about half as long.

Only programs of our own ask for it: `sys.executable` of a program that calls the library need not be Python.
"""

from __future__ import annotations

import os
import subprocess
import sys

from dqreg.kernels import gc_pause

# What it does: each process reads what the other has compiled, until both meet.
CODE = "from dqreg.kernels.compile_all import compile_all; compile_all(backwards=True)"

# The process that may start one, and has not yet.
_asking: int | None = None


def allow() -> None:
    """Let this process, a program of our own, start a second one at the first kernel not kept; a fork may not."""
    global _asking  # noqa: PLW0603
    _asking = os.getpid()
    gc_pause.freeze_survivors()
    # Numba writes, and colours, thousands of messages why a type does not fit, and throws them away.
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")


def start_if_allowed() -> None:
    """Start it, once, where this process may; it ends by itself when all is compiled."""
    global _asking  # noqa: PLW0603
    if _asking == os.getpid():
        start()
    _asking = None


def start_where_nothing_is_kept() -> None:
    """Start it before the first kernel is asked for: its imports, a second, go on beside those of this process."""
    from dqreg.kernels.cache import kept

    if not kept():
        start_if_allowed()


def start() -> subprocess.Popen[bytes] | None:
    """The second process; None where there is no core for it."""
    # NumPy is not needed for `allow`, which every command calls.
    from dqreg.kernels.threads import thread_count

    if thread_count() < 2 or not sys.executable:
        return None
    none = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-c", CODE], stdin=none, stdout=none, stderr=none)
