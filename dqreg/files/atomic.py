"""Writing a file whole or not at all: a reader never meets a half-written result.

The bytes go to a temporary file beside the goal, reach the disk, and take its name in one step.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from dqreg.errors import InputError


def require_writable(path: str | os.PathLike[str]) -> Path:
    """Path of a file that can be written; asked before long work, so that its result is not lost."""
    goal = _as_path(path)
    try:
        return _require_writable(goal)
    except OSError as error:
        # A name too long for the system, a circle of links.
        raise InputError(f"cannot write {goal}: {error.strerror or error}") from error


def _require_writable(goal: Path) -> Path:
    folder = goal.parent
    if goal.is_dir():
        raise InputError(f"cannot write {goal}: it is a folder; give the name of a file in it")
    if not folder.exists():
        raise InputError(f"cannot write {goal}: the folder {folder} does not exist; create it first")
    if not folder.is_dir():
        raise InputError(f"cannot write {goal}: {folder} is a file, not a folder")
    if goal.is_block_device():
        raise InputError(f"cannot write {goal}: it is a disk or a part of one, all of which would be lost; name a file")
    if goal.exists() and not os.access(goal, os.W_OK):
        raise InputError(f"cannot write {goal}: the file is write-protected; choose another name")
    if not is_stream(goal) and not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"cannot write {goal}: no permission to create files in {folder.absolute()}")
    return goal


def is_stream(goal: Path) -> bool:
    """Whether a name is that of a device or a pipe, as /dev/stdout: nothing takes its place, or is kept beside it."""
    return goal.exists() and not goal.is_file() and not goal.is_dir()


def require_folder(path: str | os.PathLike[str]) -> Path:
    """Folder for files, made if it is not there."""
    folder = _as_path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}; choose another one") from error
    return folder


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write a whole file; on any failure the old file, or none, is left."""
    goal = require_writable(path)
    # File names of other encodings come as letters that UTF-8 has not.
    data = content.encode("utf-8", errors="backslashreplace") if isinstance(content, str) else content
    try:
        if is_stream(goal):
            goal.write_bytes(data)
        else:
            _replace(Path(os.path.realpath(goal)), data)
    except OSError as error:
        raise InputError(f"cannot write {goal}: {error.strerror or error}") from error


def _replace(goal: Path, data: bytes) -> None:
    # The name is short and drawn, so that long names fit and two writers never share a temporary file.
    temporary = goal.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if goal.exists():
            temporary.chmod(goal.stat().st_mode & 0o7777)
        temporary.replace(goal)
    finally:
        temporary.unlink(missing_ok=True)


def _as_path(path: str | os.PathLike[str]) -> Path:
    try:
        goal = Path(path)
    except TypeError as error:
        raise InputError(f"a path must be text or a pathlib path; got {type(path).__name__}") from error
    if "\0" in str(goal):
        raise InputError(f"a path must not hold a null character; got {str(goal)!r}")
    return goal
