"""The order of files that are numbered: scan_2 comes before scan_10."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

DIGITS = re.compile(r"(\d+)")
# A number with a decimal point, as in a name of a time: as text 0.25 comes before 0.5, and 25 after 5 as a number.
DECIMAL = re.compile(r"\d\.\d")


def natural_order(path: str | os.PathLike[str]) -> tuple[list[list[tuple[int, str]]], str]:
    """A key that puts scan_2 before scan_10, folder by folder; names of one number, as 1 and 01, keep one order.

    >>> sorted(["b/scan_10.ply", "b/scan_2.ply", "a/scan_30.ply"], key=natural_order)
    ['a/scan_30.ply', 'b/scan_2.ply', 'b/scan_10.ply']
    """
    # A digit that counts nothing, as in m², is text: it would be no number.
    pieces = [
        [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in DIGITS.split(name)]
        for name in Path(path).parts
    ]
    return pieces, str(path)


def is_shell_order(paths: Sequence[Path]) -> bool:
    """Whether files that are numbered come as a shell lists them, 1, 10, 2, and not as they are numbered.

    Their names differ in whole numbers alone; another order is somebody's choice.

    >>> orders = [1, 10, 2], [1, 2, 10], [2, 10, 1]
    >>> [is_shell_order([Path(f"scan{number}.ply") for number in order]) for order in orders]
    [True, False, False]
    """
    names = [path.stem for path in paths]
    given = [str(path) for path in paths]
    if len({DIGITS.sub("#", name) for name in given}) > 1 or any(DECIMAL.search(name) for name in names):
        return False
    # By characters, or by letters and digits alone, as the shells of most languages sort.
    sorts = sorted(given), sorted(given, key=lambda name: ("".join(filter(str.isalnum, name.casefold())), name))
    return given in sorts and list(paths) != sorted(paths, key=natural_order)
