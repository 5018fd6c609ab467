"""One process at work in a folder: the others are refused, and the system lets go when the process ends."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from dqreg.errors import InputError

# Name of the file that is locked.
LOCK = ".lock"


def hold_lock(stream: IO[bytes], place: Path, command: str) -> None:
    """Hold a folder by its open lock file until that is closed; refused where another process of the command has it."""
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"another {command} is at work in {place}; wait for it, or give another --out") from None
    except OSError:
        return  # a network drive without locks
