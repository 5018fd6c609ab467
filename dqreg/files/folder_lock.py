"""One process at work in a folder: the others are refused, and the system lets go when the process ends."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from dqreg.errors import InputError

# Name of the file that is locked.
LOCK = ".lock"


@contextlib.contextmanager
def held_folder(place: Path, command: str, *within: str) -> Iterator[None]:
    """A folder, made with those within it, that no other process of a command writes to meanwhile."""
    try:
        for folder in (place, *(place / name for name in within)):
            folder.mkdir(parents=True, exist_ok=True)
        stream = (place / LOCK).open("ab")
    except OSError as error:
        raise InputError(
            f"cannot write to the folder {place}: {error.strerror or error}; give another --out"
        ) from error
    with stream:
        _hold(stream, place, command)
        yield


def _hold(stream: IO[bytes], place: Path, command: str) -> None:
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
