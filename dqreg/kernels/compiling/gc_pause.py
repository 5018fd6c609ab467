"""Garbage collection is paused while a kernel is compiled: Numba makes millions of objects, next to none is garbage."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Whether the objects left by a kernel may be frozen for good: in a program of our own, not in a caller's.
_freezes_survivors = False


def freeze_survivors() -> None:
    """Let no collection look again at the objects that a kernel leaves; garbage among them stays till the end."""
    global _freezes_survivors  # noqa: PLW0603
    _freezes_survivors = True


@contextmanager
def gc_paused() -> Iterator[None]:
    """Without garbage collection inside."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if _freezes_survivors:
            gc.freeze()
        gc.enable()
