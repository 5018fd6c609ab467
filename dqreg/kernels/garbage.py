"""Nobody looks for garbage while a kernel is compiled: Numba makes millions of objects, and next to none is garbage."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Whether what is there after a kernel may be left alone for good: in a program of our own, not in a caller's.
_leaves_alone = False


def leave_alone() -> None:
    """Never look again through what is there when a kernel is done; what is garbage of it stays till the end."""
    global _leaves_alone  # noqa: PLW0603
    _leaves_alone = True


@contextmanager
def not_collected() -> Iterator[None]:
    """Look for no garbage inside."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if _leaves_alone:
            gc.freeze()
        gc.enable()
