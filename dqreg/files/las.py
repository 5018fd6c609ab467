"""LAS and LAZ scans, read by laspy: coordinates with every digit of the file's whole numbers."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError, load_package
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.limited_process import run_limited
from dqreg.files.untrusted import require_proportion, unreadable

WANTED = "a whole LAS or LAZ file; was the file cut short?"
# Bytes of the shortest header and of the head of a record.
HEADER_BYTES, RECORD_BYTES = 227, 54
# Record with the keys of GeoTIFF, and the key that names the unit of projected coordinates.
GEO_KEYS, LINEAR_UNITS = 34735, 3076
# What that may say (EPSG).
UNITS = {9001: "m", 9002: "ft"}

# Seconds and bytes that a file may take, and those for each of its bytes.
BASE_SECONDS, SECONDS_PER_BYTE = 20.0, 1e-6
BASE_MEMORY_BYTES, MEMORY_PER_BYTE = 1 << 30, 100
UNPACK = """
import laspy
path, out = words
laspy.open(path, read_evlrs=False).read().write(out)
"""


def read_las(path: Path) -> CloudData:
    """Cloud of a LAS or LAZ file, without the points that are marked as withheld."""
    laspy: Any = load_package("laspy", "'dqreg[scans]'", f"{path}: a LAS or LAZ scan")
    load_package("lazrs", "'dqreg[scans]'", f"{path}: a LAS or LAZ scan")
    _require_records(path)
    try:
        with path.open("rb") as stream, laspy.open(stream, closefd=False, read_evlrs=False) as opened:
            header = opened.header
            require_proportion(path, int(header.point_count), int(header.point_format.size))
            las = _unpacked(path, laspy) if header.are_points_compressed else opened.read()
            points, times = _points(path, las), _times(las)
            unit = _unit(header)
    except InputError:
        raise
    except BaseException as error:
        # laspy trusts its headers and fails in many ways over damaged ones; a panic of lazrs is no Exception.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(str(error).split())[:200]
        raise unreadable(path, f"a damaged scan ({type(error).__name__}: {reason})", WANTED) from error
    return make_cloud(path, points, times=times, units=unit)


def _unpacked(path: Path, laspy: Any) -> Any:
    """Points of a LAZ file, unpacked by a process of its own: damaged sizes in it ask for any amount of memory."""
    size = path.stat().st_size
    seconds, memory = BASE_SECONDS + SECONDS_PER_BYTE * size, BASE_MEMORY_BYTES + MEMORY_PER_BYTE * size
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "unpacked.las"
        done = run_limited(UNPACK, path.resolve(), out, seconds=seconds, memory=memory)
        if done is None:
            raise unreadable(path, "what lazrs does not get done with", WANTED)
        if done.returncode or not out.is_file():
            reason = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise unreadable(path, f"a damaged scan ({' '.join(reason)[:200]})", WANTED)
        return laspy.read(out)


def _require_records(path: Path) -> None:
    """Raise if the header promises more records than the file can hold: laspy reads on beyond the end."""
    with path.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
    if head[:4] != b"LASF" or len(head) < HEADER_BYTES:
        raise unreadable(path, "a damaged header", WANTED)
    count = int.from_bytes(head[100:104], "little")
    if count * RECORD_BYTES > path.stat().st_size:
        raise unreadable(path, f"a header that promises {count} records", WANTED)


def _points(path: Path, las: Any) -> FloatArray:
    scales, offsets = np.array(las.header.scales, dtype=float), np.array(las.header.offsets, dtype=float)
    if not (np.isfinite([scales, offsets]).all() and (scales > 0.0).all()):
        found = f"scales {scales.tolist()} and offsets {offsets.tolist()}"
        raise unreadable(path, found, "finite numbers, the scales above 0")
    if len(las.points) != las.header.point_count:
        raise unreadable(path, f"{len(las.points)} of {las.header.point_count} points", WANTED)
    with np.errstate(over="ignore"):
        points: FloatArray = np.column_stack([las.X, las.Y, las.Z]) * scales + offsets
    points[np.asarray(las.withheld, dtype=bool)] = np.nan
    return points


def _times(las: Any) -> FloatArray | None:
    """Time of each point; None where all have one, as files without times do."""
    if "gps_time" not in las.point_format.dimension_names:
        return None
    times = np.asarray(las.gps_time, dtype=np.float64)
    return times if times.size and np.isfinite(times).all() and np.ptp(times) > 0.0 else None


def _unit(header: Any) -> str | None:
    """Length unit, where the keys of GeoTIFF name it."""
    for record in header.vlrs:
        if record.record_id == GEO_KEYS:
            keys = np.frombuffer(record.record_data_bytes(), dtype="<u2")
            rows = keys[: len(keys) // 4 * 4].reshape(-1, 4)[1:]
            found = rows[(rows[:, 0] == LINEAR_UNITS) & (rows[:, 1] == 0), 3]
            if len(found):
                return UNITS.get(int(found[0]))
    return None
