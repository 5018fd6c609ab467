"""PCD files: the clouds of PCL, as text, binary or compressed.

Text and binary are read with NumPy, compressed ones with Open3D after the checks that its reader (0.20) leaves
out: it aborts the process on two padding fields, and hands back memory that nobody wrote for a short row.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.column_names import find_columns, find_times
from dqreg.files.tables import parse_rows, read_text, stack_columns
from dqreg.files.untrusted import LONGEST_HEADER, unreadable

KEYWORDS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
ENCODINGS = ("ascii", "binary", "binary_compressed")
SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


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


# LZF spends three bytes on at most 264.
LZF_RATIO = 88


def read_pcd(path: Path) -> CloudData:
    """Cloud of a PCD file."""
    header = read_header(path)
    positions, normals = find_columns(path, header.fields)
    _require_length(path, header)
    if header.encoding == "ascii":
        table = _text_table(path, header)
        first = np.concatenate([[0], np.cumsum(header.counts)])
        columns = [table[:, first[k]] for k in range(len(header.fields))]
    elif header.encoding == "binary":
        rows = np.fromfile(path, dtype=header.row, count=header.points, offset=header.size)
        columns = [rows[str(k)][:, 0] for k in range(len(header.fields))]
    else:
        return _compressed_cloud(path, header)
    clock = find_times(header.fields)
    times = None if clock is None else stack_columns(columns, [clock])[:, 0]
    directions = None if normals is None else stack_columns(columns, normals)
    return make_cloud(path, stack_columns(columns, positions), directions, header.viewpoint, times)


def _require_length(path: Path, header: PcdHeader) -> None:
    rest = path.stat().st_size - header.size
    promised = header.points * header.row_bytes
    needed = promised
    if header.encoding == "ascii":
        needed = max(0, 2 * header.points * sum(header.counts) - 1)  # a digit and a space each, bar the last
    elif header.encoding == "binary_compressed":
        with path.open("rb") as stream:
            stream.seek(header.size)
            packed, unpacked = (int(n) for n in np.frombuffer(stream.read(8).ljust(8, b"\0"), dtype="<u4"))
        if unpacked != promised or unpacked > LZF_RATIO * packed:
            found = f"{packed} compressed bytes said to hold {unpacked}"
            raise unreadable(path, found, f"{promised}, as {header.points} points need; was the file cut short?")
        needed = 8 + packed
    if rest < needed:
        found = f"a header that promises {header.points} points but only {rest} bytes of them"
        raise unreadable(path, found, f"at least {needed} bytes; was the file cut short?")


def _text_table(path: Path, header: PcdHeader) -> FloatArray:
    lines = [line for line in read_text(path, skip_bytes=header.size).splitlines() if line and not line.isspace()]
    if len(lines) < header.points:
        found = f"{len(lines)} lines of points"
        raise unreadable(path, found, f"the {header.points} of its header; was the file cut short?")
    return parse_rows(path, lines[: header.points], columns=sum(header.counts))


def _compressed_cloud(path: Path, header: PcdHeader) -> CloudData:
    positions, normals = find_columns(path, header.fields)
    used = [positions] if normals is None else [positions, normals]
    alike = all(len({header.types[k] for k in trio}) == 1 for trio in used)
    if not alike or len(set(header.fields)) < len(header.fields) or set(header.counts) != {1}:
        found = "a compressed layout with padding, lists or coordinates of different types"
        raise unreadable(path, found, "plain fields; save it again with DATA binary")
    cloud = load_open3d().t.io.read_point_cloud(str(path))
    if "positions" not in cloud.point or len(cloud.point.positions) != header.points:
        raise unreadable(path, "compressed data that cannot be unpacked", f"{header.points} points")
    # The cast of a signalling NaN warns; as any NaN it is dropped and counted.
    with np.errstate(invalid="ignore"):
        points = cloud.point.positions.numpy().astype(np.float64)
        directions = cloud.point.normals.numpy().astype(np.float64) if "normals" in cloud.point else None
        clock = find_times(header.fields)
        name = "" if clock is None else header.fields[clock]
        times = cloud.point[name].numpy().astype(np.float64).ravel() if name in cloud.point else None
    if times is not None and len(times) != len(points):
        raise unreadable(path, f"{len(times)} times for {len(points)} points", "one time a point")
    return make_cloud(path, points, directions, header.viewpoint, times)
