"""Names of the rows of a batch in its files: each is a file name on any system, and no two are alike."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable

from dqreg.errors import InputError
from dqreg.registration.batch.row import Row

# Names become file names, on any system: these it refuses, and a name that begins like an option or a hidden file.
NAME = re.compile(r"""[^\s.\-/\\:*?"<>|][^/\\:*?"<>|]{0,120}(?<! )""")
# Digits that tell names apart which differ in what no file name can hold.
DIGITS = 6
# Bytes of a name, with an ending and a number within the 255 that most systems allow.
LONGEST_NAME = 240
# Devices of Windows, with whatever ending.
RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9\u00b9\u00b2\u00b3])(\.|$)", re.IGNORECASE)


class RowNames:
    """Gives each row a name of its own that is a file name everywhere; names that were given go first."""

    def __init__(self, given: Iterable[tuple[int, str]] = ()) -> None:
        self._lines: dict[str, int] = {}
        # Of all lines, before any name is made of a scan: else the order of the rows would decide whose it is.
        for line, name in given:
            if name:
                self._lines.setdefault(_key(file_name(name)), line)

    def named_or_scan(self, row: Row) -> str:
        """The name that was given, where that can be used."""
        try:
            return self.named(row, given=bool(row.name))
        except InputError:
            return self.named(row, given=False)

    def named(self, row: Row, *, given: bool) -> str:
        """The name of a row: the one that was given, or one made of its scan."""
        name = file_name(row.name) if given else _cut(row.scan.stem)
        if not given:
            name = next(each for each in _numbered(name) if _key(each) not in self._lines)
        line = self._lines.setdefault(_key(name), row.line)
        if line != row.line:
            raise InputError(f"the name {row.name!r:.150} is that of line {line}, too")
        return name


def file_name(given: str) -> str:
    """The name itself where it is a file name everywhere; else one made of it, which no other name leads to.

    >>> file_name("Part 7 (left)"), file_name("Part 7/left")
    ('Part 7 (left)', 'Part_7_left-29e662')
    """
    if (
        NAME.fullmatch(given)
        and given.isprintable()
        and len(given.encode()) <= LONGEST_NAME
        and not (RESERVED.match(given) or given.endswith("."))
    ):
        return given
    # Whatever the other rows are called, and on every run.
    return f"{_cut(given)}-{hashlib.sha256(given.encode(errors='replace')).hexdigest()[:DIGITS]}"


def _key(name: str) -> str:
    # Windows and macOS take some names that differ for the same.
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _cut(stem: str) -> str:
    """A file name of the stem of a scan that every system can hold, with room for a number."""
    name = re.sub(r"[^\w.+-]+|^\W", "_", stem)[:100]
    name = name.encode()[: LONGEST_NAME - 10].decode(errors="ignore").rstrip(".") or "scan"
    return f"_{name}" if RESERVED.match(name) else name


def _numbered(name: str) -> Iterable[str]:
    yield name
    number = 2
    while True:
        yield f"{name}-{number}"
        number += 1
