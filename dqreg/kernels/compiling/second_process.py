"""A second process that compiles kernels from the other end, so that the first use takes about half as long.

Only programs of our own ask for it: `sys.executable` of a program that calls the library need not be Python.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

from dqreg.kernels.compiling import gc_pause

# What it does: each process reads what the other has compiled, until both meet.
CODE = "from dqreg.kernels.compiling.compile_all import compile_all; compile_all(backwards=True)"

# The process that may start one, and has not yet.
_asking: int | None = None
# Whether this process says that it compiles; None: where a person looks on.
_tells: bool | None = None


def tell(*, tells: bool) -> None:
    """Have this process say that it compiles, or not, whoever reads its standard error."""
    global _tells  # noqa: PLW0603
    _tells = tells


def announce(words: str) -> None:
    """Say that this process compiles: in a program of our own unless it is quiet, in others on a terminal alone."""
    with contextlib.suppress(OSError, ValueError):
        if _tells:
            # Not through the stream, whose buffer would hold what cannot be written.
            os.write(2, words.encode())
        elif _tells is None and sys.stderr is not None and sys.stderr.isatty():
            sys.stderr.write(words)


def allow() -> None:
    """Let this process, a program of our own, start a second one at the first kernel not kept; a fork may not."""
    global _asking  # noqa: PLW0603
    _asking = os.getpid()
    tell(tells=True)
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
    from dqreg.kernels.compiling.cache import kept

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
