"""E57 scans, read by pye57: all setups in the file's one frame, in metres as the standard says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError, load_package
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.untrusted import require_proportion, unreadable

WANTED = "a whole E57 file; was the file cut short?"
# Bytes of the header, and of the checksum that ends each page.
HEADER_BYTES, CHECKSUM_BYTES = 48, 4


def read_e57(path: Path) -> CloudData:
    """Cloud of all setups of an E57 file; where they share one place that the file tells, it is the viewpoint."""
    pye57: Any = load_package("pye57", "'dqreg[scans]'", f"{path}: an E57 scan")
    _require_plain_xml(path)
    try:
        opened = pye57.E57(str(path))
        parts, places = [], []
        for number in range(opened.scan_count):
            header = opened.get_header(number)
            require_proportion(path, int(header.point_count), 3)
            if header.point_count:
                parts.append(_points(opened.read_scan(number, ignore_missing_fields=True)))
                places.append(_place(header))
        opened.close()
    except InputError:
        raise
    except Exception as error:
        # libE57Format tells of damage in its own classes, pye57 in those of Python.
        reason = " ".join(str(error).partition("****")[0].split())[:200]
        raise unreadable(path, f"a damaged scan ({type(error).__name__}: {reason})", WANTED) from error
    if not parts:
        raise unreadable(path, "no points", "at least one scan with points")
    first = places[0]
    alike = first is not None and all(place is not None and np.array_equal(place, first) for place in places)
    viewpoint = first if alike else None
    return make_cloud(path, np.concatenate(parts), viewpoint=viewpoint, units="m")


def _points(columns: dict[str, Any]) -> FloatArray:
    return np.column_stack([columns[f"cartesian{axis}"] for axis in "XYZ"]).astype(np.float64)


def _place(header: Any) -> FloatArray | None:
    """Where a setup stood; None where nothing tells: merged and exported files carry no pose, or the identity."""
    if not header.has_pose():
        return None
    place = np.asarray(header.translation, dtype=np.float64)
    if not np.isfinite(place).all():
        raise ValueError(f"a pose at {place.tolist()}")
    return place if place.any() or not np.array_equal(header.rotation_matrix, np.eye(3)) else None


def _require_plain_xml(path: Path) -> None:
    """Raise where the description of the scans names entities: they lead out of the file."""
    data = path.read_bytes()
    start, length, page = (int.from_bytes(data[at : at + 8], "little") for at in (24, 32, 40))
    if (
        data[:8] != b"ASTM-E57"
        or len(data) < HEADER_BYTES
        or not CHECKSUM_BYTES < page <= len(data)
        or not HEADER_BYTES <= start < len(data)
    ):
        raise unreadable(path, "a damaged header", WANTED)
    pages = (data[at : at + page - CHECKSUM_BYTES] for at in range(start // page * page, len(data), page))
    text = b"".join(pages)[start % page :][:length]
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise unreadable(path, "a description with entities", "an E57 file without")
