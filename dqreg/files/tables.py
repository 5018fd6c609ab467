"""Tables of coordinates as text: XYZ, XYZN, TXT and CSV, with or without a line of column names, and PTS."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.column_names import common_unit, find_columns, find_times, plain_names
from dqreg.files.untrusted import unreadable


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
    lines: Iterable[str],
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
    count = len(lines) if isinstance(lines, list) else -1
    if not count:
        return np.zeros((0, columns or 0))
    try:
        table = np.loadtxt(lines, dtype=np.float64, delimiter=delimiter, usecols=wanted, ndmin=2, comments=None)
    except ValueError as error:
        # NumPy's second clause advises programmers.
        reason = str(error).split(";")[0].rstrip(".")
        found = f"{reason} (counted from the first row of numbers)"
        raise unreadable(path, found, "as many numbers in each row") from error
    if columns is not None and table.shape != (count, columns):
        found = f"{len(table)} rows of {table.shape[1]} numbers"
        raise unreadable(path, found, f"{count} rows of {columns}; was the file cut short?")
    return table


def stack_columns(columns: Sequence[FloatArray], wanted: Sequence[int]) -> FloatArray:
    """Some columns side by side, in float64.

    Shapes: returns (n, number wanted).

    >>> stack_columns([np.array([1, 2]), np.array([3, 4])], [1, 0]).tolist()
    [[3.0, 1.0], [4.0, 2.0]]
    """
    # The cast of a signalling NaN warns; as any NaN it is dropped and counted later.
    with np.errstate(invalid="ignore"):
        return np.stack([columns[k].astype(np.float64) for k in wanted], axis=1)


COMMENTS = ("#", "//")


def read_table(path: Path) -> CloudData:
    """Cloud of a text table.

    Columns are found by name where a first line (or a comment above the numbers) names them; their unit counts.
    Without names there must be three, x y z; four, with an intensity, which is not used; or six, x y z nx ny nz; before
    them may be the name or the number of each point. Numbers are parted by white space, commas or semicolons (beside
    blanks or semicolons a comma is the decimal sign); an empty field counts as NaN.
    """
    names, lines = _split_header(path, read_text(path).splitlines())
    delimiter = _delimiter(lines[0])
    fields = next(_tidy(lines, delimiter)).split(delimiter)
    width = len(fields)
    if names is not None and len(names) != width:
        raise unreadable(path, f"{len(names)} column names over {width} columns", "one name for each column")
    if names is None:
        table = parse_rows(path, _tidy(lines, delimiter), delimiter=delimiter, wanted=_beside_words(fields))
        return nameless_cloud(path, table, trust_normals=path.suffix.lower() == ".xyzn")
    plain, units = plain_names(names)
    positions, normals = find_columns(path, plain)
    unit = common_unit(path, [units[k] for k in positions])
    wanted, clock = positions + (normals or []), find_times(plain)
    table, times = _with_times(path, lines, delimiter, wanted, clock)
    return make_cloud(path, table[:, :3], table[:, 3:] if normals else None, times=times, units=unit)


def _with_times(
    path: Path, lines: list[str], delimiter: str | None, wanted: list[int], clock: int | None
) -> tuple[FloatArray, FloatArray | None]:
    """The wanted columns, and the times of the rows where a column of numbers holds them: dates are none."""
    if clock is not None:
        with contextlib.suppress(InputError):
            table = parse_rows(path, _tidy(lines, delimiter), delimiter=delimiter, wanted=[*wanted, clock])
            return table[:, :-1], table[:, -1]
    return parse_rows(path, _tidy(lines, delimiter), delimiter=delimiter, wanted=wanted), None


# How far the length of a normal may be from 1 after rounding, and in how many of the rows.
ROUNDED_NORMAL, MOST_ROWS = 0.02, 0.9


def nameless_cloud(path: Path, table: FloatArray, *, trust_normals: bool = False) -> CloudData:
    """Cloud of a table whose columns have no names.

    >>> nameless_cloud(Path("a.xyz"), np.array([[1.0, 2, 3, 0, 0, 1]])).normals
    array([[0., 0., 1.]])
    """
    if table.shape[1] in (4, 5, 7) and _counts(table[:, 0]):
        _tell_numbered(path, table.shape[1])
        table = table[:, 1:]
    # The fourth of four is an intensity: what most scanners export.
    table = table[:, :3] if table.shape[1] == 4 else table
    width = table.shape[1]
    if width not in (3, 6):
        raise unreadable(path, f"{width} columns", "3 (x y z) or 6 (with normals); name others in a first line")
    if width == 3:
        return make_cloud(path, table)
    # What is too long to be squared is no normal of length 1.
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(table[:, 3:], axis=1)
    lengths = lengths[np.isfinite(lengths) & (lengths > 0.0)]
    # Colours of 0..1 have a typical length near 1 too, but no row has just that.
    if not trust_normals and len(lengths) and np.mean(np.abs(lengths - 1.0) < ROUNDED_NORMAL) < MOST_ROWS:
        low, typical, high = np.quantile(lengths, [0.05, 0.5, 0.95])
        found = f"columns 4 to 6 with a typical length of {typical:.3g}, from {low:.3g} to {high:.3g}"
        raise unreadable(path, found, "normals of length 1; name the columns (normals or colours) in a first line")
    return make_cloud(path, table[:, :3], table[:, 3:])


# Rows of which the first column counts, at least: in fewer it may be a coordinate.
LEAST_NUMBERED = 5


def _counts(column: FloatArray) -> bool:
    """Whether a column holds 0, 1, 2, ... or 1, 2, 3, ..., and nothing else."""
    first = column[0] if len(column) >= LEAST_NUMBERED else math.nan
    return first in (0.0, 1.0) and bool(np.array_equal(column, first + np.arange(len(column))))


def _tell_numbered(path: Path, width: int) -> None:
    warnings.warn(
        f"{path}: the first of {width} columns counts the rows and is taken for their numbers, not for x; if it is x, "
        "name the columns in a first line, such as: x y z intensity",
        UserWarning,
        stacklevel=2,
    )


def _beside_words(fields: Sequence[str]) -> list[int] | None:
    """Columns of numbers, from the first row: without names of points before them and words behind; None: all."""
    numeric = [k for k, field in enumerate(fields) if _is_number(field)]
    if not numeric or numeric[0] > 1 or numeric != list(range(numeric[0], numeric[-1] + 1)):
        return None
    # Of four the last is an intensity, unless the first may count the rows.
    if len(numeric) == 4 and float(fields[numeric[0]]) not in (0.0, 1.0):
        return numeric[:3]
    return None if len(numeric) == len(fields) else numeric


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _split_header(path: Path, lines: list[str]) -> tuple[list[str] | None, list[str]]:
    remark: list[str] | None = None
    header: list[str] | None = None
    for k, line in enumerate(lines):
        words = _words(line.strip().lstrip("#/"))
        if not words or line.isspace():
            continue
        if line.lstrip().startswith(COMMENTS):
            remark = words if {"x", "y", "z"} <= {word.lower() for word in plain_names(words)[0]} else remark
        elif header is None and len(words) == 1 and words[0].isdigit() and _is_count(words[0], lines[k + 1 :]):
            continue
        elif _is_numbers(line):
            fits = remark is not None and len(remark) == len(line.split(_delimiter(line)))
            return header or (remark if fits else None), lines[k:]
        elif header is None:
            header = words
        else:
            raise unreadable(path, f"the line {line.strip()[:60]!r}", "numbers below the column names")
    raise unreadable(path, "no row of numbers", "one row per point: x, y, z")


def _is_count(word: str, rows: Sequence[str]) -> bool:
    """Whether a line of its own is the number of the rows below it, as some programs write."""
    return word.isascii() and len(word) < 20 and int(word) == sum(not row.isspace() and row != "" for row in rows)


def _words(line: str) -> list[str]:
    # A unit in brackets belongs to the name before it.
    parts = re.split(r"[,;]" if re.search("[,;]", line) else r"\s+(?![\[(]|coord)", line.strip())
    return [part.strip().strip("\"'") for part in parts] if line.strip() else []


def _is_numbers(line: str) -> bool:
    delimiter = _delimiter(line)
    fields = next(_tidy([line], delimiter)).split(delimiter)
    # A column that is not used may hold words; a row of data still has a number somewhere.
    return all(map(_is_number, fields)) or any(NUMBER.fullmatch(field) for field in fields)


NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
# Numbers with decimal commas between blanks: of fewer than three words a comma parts columns.
COMMA = re.compile(r"[-+]?(\d+(,\d*)?|,\d+)([eE][-+]?\d+)?")


def _delimiter(line: str) -> str | None:
    if ";" in line:
        return ";"
    words = line.split()
    decimal = len(words) > 2 and all(COMMA.fullmatch(word) for word in words)
    return "," if "," in line and not decimal else None


def _tidy(lines: Iterable[str], delimiter: str | None) -> Iterator[str]:
    # One after the other: a row takes ten times its letters in memory.
    gap = re.compile(rf"(^|{delimiter})\s*(?={delimiter}|$)")
    for line in lines:
        if not line or line.isspace() or line.lstrip().startswith(COMMENTS):
            continue
        if delimiter is None:
            # Between blanks a comma is a decimal sign.
            yield line.replace(",", ".")
            continue
        row = line.replace(",", ".") if delimiter == ";" else line
        yield gap.sub(r"\1nan", row) if gap.search(row) else row


def read_pts(path: Path) -> CloudData:
    """Cloud of a PTS file: blocks of a count and as many rows x y z, perhaps with intensity and colour."""
    lines = [line for line in map(str.strip, read_text(path).splitlines()) if line]
    blocks, at = [], 0
    while at < len(lines):
        if not lines[at].isascii() or not lines[at].isdigit():
            raise unreadable(path, f"the line {lines[at][:60]!r}", "a number of points above its rows")
        count = int(lines[at][:20])
        rows = lines[at + 1 : at + 1 + count]
        if len(rows) < count:
            raise unreadable(path, f"{len(rows)} rows under the number {count}", "as many; was the file cut short?")
        if count:
            table = parse_rows(path, rows)
            if table.shape[1] not in (3, 4, 6, 7):
                raise unreadable(path, f"rows of {table.shape[1]} numbers", "x y z, with intensity, colour or both")
            blocks.append(table[:, :3])
        at += 1 + count
    return make_cloud(path, np.concatenate(blocks) if blocks else np.zeros((0, 3)))
