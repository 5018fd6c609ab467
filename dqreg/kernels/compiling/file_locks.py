"""Processes that need the same kernel at the same time: one compiles it, the others wait and read it.

A batch of eight workers on a new machine would compile everything eight times.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

# Longer than any kernel takes to compile on a loaded machine: then each goes on by itself.
PATIENCE = 60.0
PAUSE = 0.02


class FileLocks:
    """Locks on files beside the code, which the system lets go of however a process ends."""

    def __init__(self) -> None:
        self._held: dict[Path, tuple[Path, int]] = {}

    def acquire(self, folder: Path | None, file: Path) -> bool:
        """Wait for the lock of a file; True where another process may have written that file meanwhile."""
        if folder is None or file in self._held:
            return False
        try:
            import fcntl

            path = folder / f"{file}.lock"
            opened = os.open(path, os.O_CREAT | os.O_WRONLY, 0o600)
        except (ImportError, OSError):
            return False
        began = time.monotonic()
        while time.monotonic() - began < PATIENCE:
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(PAUSE)
            except OSError:  # a network drive without locks
                break
            else:
                self._held[file] = path, opened
                return True
        os.close(opened)
        return False

    def release(self, file: Path) -> None:
        """Let the next process have the lock, where it is held."""
        if file in self._held:
            import fcntl

            path, opened = self._held.pop(file)
            with suppress(OSError):
                path.unlink()
                # Closing alone would leave it to a process that was forked meanwhile.
                fcntl.flock(opened, fcntl.LOCK_UN)
            os.close(opened)
