"""Text files of numbers: their characters, and their rows as an array."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.opening import unreadable


def read_text(path: Path, skip_bytes: int = 0) -> str:
    """Text of a file."""
    with path.open("rb") as stream:
        stream.seek(skip_bytes)
        data = stream.read()
    if b"\0" in data:
        raise unreadable(path, "binary data", "text: one row of numbers per point (UTF-8, not UTF-16)")
    return data.decode("utf-8-sig", errors="replace")


def parse_rows(
    path: Path,
    lines: list[str],
    *,
    columns: int | None = None,
    delimiter: str | None = None,
    wanted: Sequence[int] | None = None,
) -> FloatArray:
    """Numbers of text lines.

    Shapes: returns (rows, columns).

    >>> parse_rows(Path("a.xyz"), ["1 2 3", "4 5 nan"]).shape
    (2, 3)
    """
    if not lines:
        return np.zeros((0, columns or 0))
    try:
        table = np.loadtxt(lines, dtype=np.float64, delimiter=delimiter, usecols=wanted, ndmin=2, comments=None)
    except ValueError as error:
        # NumPy's second clause advises programmers.
        reason = str(error).split(";")[0].rstrip(".")
        found = f"{reason} (counted from the first row of numbers)"
        raise unreadable(path, found, "as many numbers in each row") from error
    if columns is not None and table.shape != (len(lines), columns):
        found = f"{len(table)} rows of {table.shape[1]} numbers"
        raise unreadable(path, found, f"{len(lines)} rows of {columns}; was the file cut short?")
    return table
