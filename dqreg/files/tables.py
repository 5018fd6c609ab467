"""Tables of coordinates as text: XYZ, XYZN, TXT and CSV, with or without a line of column names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.columns import find_columns
from dqreg.files.opening import unreadable
from dqreg.files.text_table import parse_rows, read_text

COMMENTS = ("#", "//")


def read_table(path: Path) -> CloudData:
    """Cloud of a text table.

    Columns are found by name where a first line (or a comment above the numbers) names them. Without names there must
    be three, x y z, or six, x y z nx ny nz. Numbers are parted by white space, commas or semicolons (then a comma may
    be the decimal sign); an empty field counts as NaN.
    """
    names, lines = _split_header(path, read_text(path).splitlines())
    delimiter = _delimiter(lines[0])
    lines = _tidy(lines, delimiter)
    width = len(lines[0].split(delimiter))
    if names is not None and len(names) != width:
        raise unreadable(path, f"{len(names)} column names over {width} columns", "one name for each column")
    if names is None:
        table = parse_rows(path, lines, delimiter=delimiter)
        return nameless_cloud(path, table, trust_normals=path.suffix.lower() == ".xyzn")
    positions, normals = find_columns(path, names)
    table = parse_rows(path, lines, delimiter=delimiter, wanted=positions + (normals or []))
    return make_cloud(path, table[:, :3], table[:, 3:] if normals else None)


def nameless_cloud(path: Path, table: FloatArray, *, trust_normals: bool = False) -> CloudData:
    """Cloud of a table whose columns have no names.

    >>> nameless_cloud(Path("a.xyz"), np.array([[1.0, 2, 3, 0, 0, 1]])).normals
    array([[0., 0., 1.]])
    """
    width = table.shape[1]
    if width not in (3, 6):
        raise unreadable(path, f"{width} columns", "3 (x y z) or 6 (with normals); name others in a first line")
    if width == 3:
        return make_cloud(path, table)
    lengths = np.linalg.norm(table[:, 3:], axis=1)
    lengths = lengths[np.isfinite(lengths) & (lengths > 0.0)]
    typical = float(np.median(lengths)) if len(lengths) else 1.0
    # Half and double leave room for rounded and averaged normals; colours of 0..255 are far outside.
    if not trust_normals and not 0.5 < typical < 2.0:
        found = f"columns 4 to 6 with a typical length of {typical:.3g}"
        raise unreadable(path, found, "normals of length 1; name the columns in a first line")
    return make_cloud(path, table[:, :3], table[:, 3:])


def _split_header(path: Path, lines: list[str]) -> tuple[list[str] | None, list[str]]:
    remark: list[str] | None = None
    header: list[str] | None = None
    for k, line in enumerate(lines):
        words = _words(line.strip().lstrip("#/"))
        if not words or line.isspace():
            continue
        if line.lstrip().startswith(COMMENTS):
            remark = words if {"x", "y", "z"} <= {word.lower() for word in words} else remark
        elif _is_numbers(line):
            fits = remark is not None and len(remark) == len(line.split(_delimiter(line)))
            return header or (remark if fits else None), lines[k:]
        elif header is None:
            header = words
        else:
            raise unreadable(path, f"the line {line.strip()[:60]!r}", "numbers below the column names")
    raise unreadable(path, "no row of numbers", "one row per point: x, y, z")


def _words(line: str) -> list[str]:
    parts = re.split(r"[,;]" if re.search("[,;]", line) else r"\s+", line.strip())
    return [part.strip().strip("\"'") for part in parts] if line.strip() else []


def _is_numbers(line: str) -> bool:
    delimiter = _delimiter(line)
    fields = _tidy([line], delimiter)[0].split(delimiter)
    try:
        return bool([float(field) for field in fields])
    except ValueError:
        # A column that nobody asks for may hold words; a row of data still has a number somewhere.
        return any(re.fullmatch(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*", field) for field in fields)


def _delimiter(line: str) -> str | None:
    return next((sign for sign in (";", ",") if sign in line), None)


def _tidy(lines: list[str], delimiter: str | None) -> list[str]:
    rows = [line for line in lines if line and not line.isspace() and not line.lstrip().startswith(COMMENTS)]
    if delimiter is None:
        return rows
    if delimiter == ";":
        rows = [row.replace(",", ".") for row in rows]
    gap = re.compile(rf"(^|{delimiter})\s*(?={delimiter}|$)")
    return [gap.sub(r"\1nan", row) if gap.search(row) else row for row in rows]
