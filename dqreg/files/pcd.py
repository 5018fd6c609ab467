"""PCD files: the clouds of PCL, as text, binary or compressed.

Text and binary are read with NumPy, compressed ones with Open3D after the checks that its reader (0.20) leaves
out: it aborts the process on two padding fields, and hands back memory that nobody wrote for a short row.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.columns import find_columns, stack_columns
from dqreg.files.opening import unreadable
from dqreg.files.pcd_header import PcdHeader, read_header
from dqreg.files.text_table import parse_rows, read_text
from dqreg.open3d_gate import load_open3d

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
    points = stack_columns(columns, positions)
    return make_cloud(path, points, None if normals is None else stack_columns(columns, normals), header.viewpoint)


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
    return make_cloud(path, points, directions, header.viewpoint)
