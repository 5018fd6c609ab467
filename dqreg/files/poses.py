"""A pose in a file: 4x4 or 3x4 text, row by row, in any lines; an array of NumPy; JSON with ``T_target_source``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_pose, with_last_row
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.files.tables import read_text
from dqreg.files.untrusted import require_readable, unreadable

POSE = "T_target_source"
# Starts that need no file.
START_WORDS = ("none", "identity")
BETWEEN = str.maketrans(",[]", "   ")


def read_pose(path: str | os.PathLike[str]) -> FloatArray:
    """Pose of a file, as it stands there: not mended, NaN where nothing was found."""
    path = require_readable(path, "a pose")
    kind = path.suffix.lower()
    if kind != ".npy" and (holds_object(path) or (kind == ".json" and not _begins(path, b"["))):
        rows = read_json(path, f"a pose, the key {POSE!r}").get(POSE)
        if rows is None:
            raise InputError(f"{path}: the key {POSE!r} is missing; give a result.json, a truth.json or a 4x4 text")
        return _matrix(_with_nan(rows), path)
    return _matrix(_read_array(path) if kind == ".npy" else _read_table(path), path)


def holds_object(path: Path) -> bool:
    """Whether a file begins as an object of JSON does, whatever its name."""
    return _begins(path, b"{")


def _begins(path: Path, letter: bytes) -> bool:
    with path.open("rb") as stream:
        return stream.read(64).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(letter)


def read_start(text: str | os.PathLike[str]) -> FloatArray | str | None:
    """Initial pose of a word, a file or an alternative (``result.json#2``), as `dqreg.register` takes it."""
    if text in START_WORDS:
        return None if text == "none" else str(text)
    try:
        found = Path(text).is_file()
    except OSError:
        found = False  # a name too long for the system
    path, mark, number = os.fspath(text).rpartition("#")
    if not found and mark and number.isdecimal():
        return _alternative(path, int(number))
    if not found:
        raise InputError(
            f"start must be none, identity or a file with a 4x4 pose; there is no file {os.fspath(text)!r:.300}"
        )
    T = read_pose(text)
    if np.isnan(T).all():
        raise InputError(f"start {text}: no pose was found there; give another result, or start from none")
    as_pose(T, f"start {text}")  # looked at, but kept as it was: to the last bit
    return T


def _alternative(path: str, number: int) -> FloatArray:
    """Another pose of a result, counted from 1."""
    found = read_json(path, "a result").get("alternatives")
    if not isinstance(found, list) or not 1 <= number <= len(found):
        has = f"{len(found)} alternatives" if isinstance(found, list) and found else "no alternatives"
        raise InputError(f"start {path}#{number}: that result has {has}; they are counted from 1")
    rows = found[number - 1].get(POSE) if isinstance(found[number - 1], dict) else None
    T = _matrix(_with_nan(rows), Path(path))
    as_pose(T, f"start {path}#{number}")
    return T


def _read_table(path: Path) -> FloatArray:
    try:
        # Some programs write poses with commas, Python and JSON with brackets, and break their lines anywhere.
        text = read_text(path)
        lines = [line for line in text.translate(BETWEEN).splitlines() if line.partition("#")[0].strip()]
        if not lines:
            raise ValueError("it is empty")
        rows = np.loadtxt([" ".join(lines)] if "[" in text else lines, ndmin=2)
        return rows.reshape(-1, 4) if rows.size in (12, 16) and 1 in rows.shape else rows
    except InputError as error:
        raise unreadable(path, "binary data", "a 4x4 pose of plain numbers, or a result.json") from error
    except ValueError as error:
        raise InputError(f"cannot read {path}: not a 4x4 pose of plain numbers ({error})") from error


def _read_array(path: Path) -> Any:
    try:
        # Mapped first: a header that promises too much fails before memory is taken.
        np.load(path, mmap_mode="r", allow_pickle=False)
        return np.load(path, allow_pickle=False)
    except Exception as error:
        # A damaged header is parsed as Python, which fails in as many ways as Python has errors.
        raise unreadable(path, f"no plain array ({error})", "4x4 numbers, as numpy.save writes them") from error


def _with_nan(rows: Any) -> Any:
    if not isinstance(rows, list):
        return rows
    return [_with_nan(row) if isinstance(row, list) else (np.nan if row is None else row) for row in rows]


def _matrix(rows: Any, path: Path) -> FloatArray:
    try:
        T = with_last_row(as_float(rows, str(path)))
    except InputError as error:
        raise InputError(f"{path}: {POSE} must be 4x4 numbers ({error})") from error
    if T.shape != (4, 4):
        raise InputError(f"{path}: a pose is 4x4 numbers; got shape {T.shape}")
    return T
