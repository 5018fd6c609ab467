"""Clouds whose numbers have names: structured arrays, PointCloud2 messages, tables and dictionaries of columns."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.files.column_names import NORMAL_NAMES, POSITION_NAMES, TIME_NAMES

# One field of three numbers a point.
TRIPLES, NORMAL_TRIPLES = ("xyz", "points", "positions", "position"), ("normals", "normal")
# Datatypes of sensor_msgs/PointField, from 1 on.
DATATYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")


@dataclasses.dataclass(frozen=True)
class RawCloud:
    """What a cloud of another library holds, all rows of it."""

    points: FloatArray  # (n, 3): perhaps not finite
    normals: FloatArray | None = None  # (n, 3)
    times: FloatArray | None = None  # (n,): time of each point


def columns_of(value: Any, names: Iterable[Any]) -> RawCloud:
    """Points, normals and times of whatever gives a column by its name."""
    known: dict[str, Any] = {}
    for name in names:
        known.setdefault(str(name).lower(), name)

    def column(name: str) -> FloatArray:
        rows = np.asarray(value[known[name]])
        # Whole nanoseconds since 1970 have more digits than float64: differences keep them all.
        rows = rows - rows.min() if rows.dtype.kind in "iu" and rows.size and name in TIME_NAMES else rows
        return as_float(rows, f"the field {known[name]!r}")

    points = _rows(known, column, POSITION_NAMES, TRIPLES)
    if points is None:
        listed = ", ".join(map(str, known.values())) or "none"
        polar = "; convert ranges and angles first (pye57: read_scan)" if "sphericalrange" in known else ""
        raise InputError(f"the fields must hold x, y and z; got {listed}{polar}")
    time = next((name for name in TIME_NAMES if name in known), None)
    times = None if time is None else column(time).ravel()
    normals = _rows(known, column, NORMAL_NAMES, NORMAL_TRIPLES)
    if normals is not None and not np.nan_to_num(normals).any():
        normals = None  # fields that nobody filled
    for part, rows in (("normals", normals), ("times", times)):
        if rows is not None and len(rows) != len(points):
            raise InputError(f"all fields must have one length; got {len(points)} points and {len(rows)} {part}")
    return RawCloud(points, normals, times)


def _rows(
    known: dict[str, Any], column: Any, triples: Sequence[tuple[str, str, str]], single: Sequence[str]
) -> FloatArray | None:
    """Three columns side by side, (n, 3), or the one that holds all three numbers."""
    for triple in triples:
        if set(triple) <= known.keys():
            parts = [column(name).ravel() for name in triple]
            if len({len(part) for part in parts}) > 1:
                lengths = ", ".join(str(len(part)) for part in parts)
                raise InputError(f"the fields {', '.join(triple)} must have one length; got {lengths}")
            return np.column_stack(parts)
    for name in single:
        if name in known:
            rows = column(name)
            return rows.reshape(-1, 3) if rows.ndim > 1 and rows.shape[-1] == 3 else None
    return None


def from_message(message: Any) -> RawCloud:
    """A sensor_msgs/PointCloud2, of whichever library read it."""
    records = message_records(message)
    return columns_of(records, records.dtype.names or ())


def message_records(message: Any) -> Any:
    """Points of a PointCloud2 as a structured array, (n,): the fields that are used, whatever the padding between."""
    try:
        height, width, step = int(message.height), int(message.width), int(message.point_step)
        row = int(message.row_step) or width * step
        swapped = bool(message.is_bigendian) != (sys.byteorder == "big")
        wanted = {*sum((*POSITION_NAMES, *NORMAL_NAMES), ()), *TIME_NAMES}
        fields = {f.name: f for f in message.fields if str(f.name).lower() in wanted and int(f.count or 1) == 1}
        kinds = [DATATYPES[_datatype(field)] for field in fields.values()]
        kind = np.dtype(
            {
                "names": list(fields),
                "formats": [np.dtype(kind).newbyteorder("S") if swapped else np.dtype(kind) for kind in kinds],
                "offsets": [int(field.offset) for field in fields.values()],
                "itemsize": step,
            }
        )
        data = np.frombuffer(_buffer(message.data), dtype=np.uint8)
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"a damaged PointCloud2 message: {error}") from error
    needed = (height - 1) * row + width * step if height * width else 0
    if min(height, width) < 0 or step <= 0 or row < width * step or len(data) < needed:
        raise InputError(
            f"a damaged PointCloud2 message: {height} x {width} points of {step} bytes, rows of {row}, in {len(data)} "
            "bytes of data"
        )
    if not height * width:
        return np.zeros(0, dtype=kind)
    return np.ndarray((height, width), dtype=kind, buffer=data, strides=(row, step)).reshape(-1)


def _datatype(field: Any) -> int:
    number = int(field.datatype)
    if not 1 <= number <= len(DATATYPES):
        raise ValueError(f"the field {field.name!r} has the datatype {number}; known are 1 to {len(DATATYPES)}")
    return number - 1


def _buffer(data: Any) -> Any:
    return bytes(data) if isinstance(data, (list, tuple)) else data


def stamp_of(value: Any) -> float | None:
    """Time of a message in its header, seconds; None where it has none."""
    stamp = getattr(getattr(value, "header", None), "stamp", None)
    for whole, rest in (("sec", "nanosec"), ("secs", "nsecs")):
        if hasattr(stamp, whole) and hasattr(stamp, rest):
            # Whole numbers are divided exactly: the same float as of the decimal number.
            return (int(getattr(stamp, whole)) * 10**9 + int(getattr(stamp, rest))) / 10**9
    return None
