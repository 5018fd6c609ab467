"""Header of a PCD file: its fields, its points and the sensor's place."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.opening import unreadable

KEYWORDS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
ENCODINGS = ("ascii", "binary", "binary_compressed")
SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
LONGEST_HEADER = 1 << 20


@dataclasses.dataclass(frozen=True)
class PcdHeader:
    """What a PCD header says."""

    fields: tuple[str, ...]  # Names, in order; a field with a count of k is one name
    types: tuple[str, ...]  # NumPy code of each field
    counts: tuple[int, ...]  # Numbers that each field holds
    points: int  # Rows
    encoding: str  # ``ascii``, ``binary`` or ``binary_compressed``
    viewpoint: FloatArray | None  # (3,): Where the sensor stood; None if the file has only the default
    size: int  # Bytes of the header

    @property
    def row_bytes(self) -> int:
        """Bytes of one point, however absurd the counts."""
        return sum(int(kind[1]) * count for kind, count in zip(self.types, self.counts, strict=True))

    @property
    def row(self) -> np.dtype[np.void]:
        """The record of one point; fields are numbered, because padding fields share a name."""
        return np.dtype(
            [(str(k), "<" + kind, (n,)) for k, (kind, n) in enumerate(zip(self.types, self.counts, strict=True))]
        )


def read_header(path: Path) -> PcdHeader:
    """Header of a PCD file."""
    entries, size = _entries(path)
    fields = entries["FIELDS"]
    width, height = (_whole(path, entries, key, "1") for key in ("WIDTH", "HEIGHT"))
    points = _whole(path, entries, "POINTS", str(width * height))
    if "WIDTH" in entries and width * height != points:
        raise unreadable(path, f"{points} points in a grid of {width} x {height}", "POINTS = WIDTH x HEIGHT")
    counts = entries.get("COUNT", ["1"] * len(fields))
    sizes, kinds = entries["SIZE"], entries["TYPE"]
    if not len(fields) == len(sizes) == len(kinds) == len(counts):
        found = f"{len(fields)} FIELDS, {len(sizes)} SIZE, {len(kinds)} TYPE and {len(counts)} COUNT entries"
        raise unreadable(path, found, "as many of each")
    types = []
    for kind, length, count in zip(kinds, sizes, counts, strict=True):
        if length not in [str(size) for size in SIZES.get(kind, ())] or not _is_whole(count) or int(count) < 1:
            raise unreadable(path, f"a field of TYPE {kind}, SIZE {length}, COUNT {count:.40}", "for example F, 4, 1")
        types.append(kind.lower() + length)
    encoding = entries["DATA"][0].lower() if entries["DATA"] else ""
    if encoding not in ENCODINGS:
        raise unreadable(path, f"DATA {encoding}", f"one of {', '.join(ENCODINGS)}")
    numbers = tuple(int(count) for count in counts)
    return PcdHeader(tuple(fields), tuple(types), numbers, points, encoding, _viewpoint(path, entries), size)


def _entries(path: Path) -> tuple[dict[str, list[str]], int]:
    with path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = head.find(b"\n", at)
        if end < 0:
            raise unreadable(path, "a PCD header without its DATA line", "a whole PCD file")
        words = head[at:end].decode("ascii", errors="replace").split()
        at = end + 1
        if not words or words[0].startswith("#"):
            continue
        key = "FIELDS" if words[0] == "COLUMNS" else words[0]  # the name in version 0.5
        if key not in KEYWORDS:
            raise unreadable(path, f"the header line {' '.join(words)[:60]!r}", "a PCD header (VERSION, FIELDS, ...)")
        entries[key] = words[1:]
    missing = [key for key in ("FIELDS", "SIZE", "TYPE") if key not in entries]
    if "POINTS" not in entries and "WIDTH" not in entries:
        missing.append("POINTS")
    if missing:
        raise unreadable(path, f"a PCD header without {', '.join(missing)}", "a whole header")
    return entries, at


def _is_whole(word: str) -> bool:
    # No count of anything has more digits, and Python refuses to read some thousand of them.
    return word.isdecimal() and len(word) <= 18


def _whole(path: Path, entries: dict[str, list[str]], key: str, default: str) -> int:
    words = entries.get(key, [default])
    if len(words) != 1 or not _is_whole(words[0]):
        raise unreadable(path, f"{key} {' '.join(words):.40}", f"{key} and one whole number")
    return int(words[0])


def _viewpoint(path: Path, entries: dict[str, list[str]]) -> FloatArray | None:
    words = entries.get("VIEWPOINT", [])
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = (math.nan,)
    if not numbers or numbers == DEFAULT_VIEWPOINT:
        return None
    if len(numbers) != 7 or not all(math.isfinite(number) for number in numbers):
        raise unreadable(path, f"VIEWPOINT {' '.join(words)}", "seven numbers: tx ty tz qw qx qy qz")
    return np.array(numbers[:3])
