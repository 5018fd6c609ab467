"""The order of files that are numbered: scan_2 comes before scan_10."""

from __future__ import annotations

import os
import re
from pathlib import Path

DIGITS = re.compile(r"(\d+)")


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
