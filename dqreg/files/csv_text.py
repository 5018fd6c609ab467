"""Tables as CSV that a spreadsheet shows and does not run: names of files and parts come from anybody.

A spreadsheet takes a cell such as ``=cmd|' /C calc'!A0`` for a formula. Such words are written with an apostrophe
before them, which `csv_rows` takes off again; numbers stay as they are.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator
from types import SimpleNamespace

from dqreg.errors import InputError

# How a formula begins, in the wide letters of East Asia too; after apostrophes, so that each text comes back as it was.
FORMULA = re.compile("'*[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")


def csv_text(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    r"""Rows as CSV, at full precision.

    >>> csv_text(["name", "x"], [["=1+2", -0.5], ["-0.5", 3]])
    "name,x\n'=1+2,-0.5\n-0.5,3\n"
    """
    lines: list[str] = []
    # With this ending a lone carriage return in a word is quoted too; each line is written in one call.
    writer = csv.writer(SimpleNamespace(write=lines.append), lineterminator="\r\n")
    writer.writerow(map(_cell, head))
    writer.writerows(map(_cell, row) for row in rows)
    return "".join(f"{line[:-2]}\n" for line in lines)


def csv_rows(text: str) -> Iterator[dict[str, str]]:
    r"""The rows of what `csv_text` wrote, by the names of their columns.

    >>> list(csv_rows("name,x\n'=1+2,-0.5\n"))
    [{'name': '=1+2', 'x': '-0.5'}]
    """
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        head = [_word(cell) for cell in next(reader, [])]
        for cells in reader:
            yield dict(zip(head, map(_word, cells), strict=False))
    except csv.Error as error:
        raise InputError(f"line {reader.line_num} is not CSV: {error}") from error


def _cell(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and FORMULA.match(cell) and not _is_number(cell) else cell


def _word(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and FORMULA.match(cell) else cell


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return not text.startswith(("\t", "\r", "\n"))
