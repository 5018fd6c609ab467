"""Initial poses of many scans: from an argument, or from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.files.poses import read_json
from dqreg.rigid import quaternion


def read_starts(starts: Any, count: int) -> list[FloatArray | None]:
    """Initial poses, checked; None where there is none."""
    if starts is None:
        return [None] * count
    try:
        listed = list(starts)
    except TypeError:
        listed = []
    if len(listed) != count:
        raise InputError(f"starts must hold one 4x4 pose T_world_scan (or None) a scan; got {len(listed)} for {count}")
    return [None if _is_empty(start) else as_pose(start, f"starts[{k}]") for k, start in enumerate(listed)]


def _is_empty(start: Any) -> bool:
    if start is None:
        return True
    try:
        numbers = np.asarray(start, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return numbers.shape == (4, 4) and bool(np.isnan(numbers).all())


def read_starts_file(path: Path) -> list[FloatArray]:
    """Poses of a KITTI or TUM file, or of an earlier result; NaN where there is none."""
    if path.suffix.lower() == ".json":
        rows = read_json(path).get("T_world_scan")
        if not isinstance(rows, list):
            raise InputError(f"{path}: the key 'T_world_scan' is missing; give a result of dqreg multiway")
        return [np.array(T, dtype=np.float64) for T in rows]
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read the initial poses {path}: {error}") from error
    if rows.shape[1:] not in ((8,), (12,), (16,)):
        raise InputError(f"{path}: lines of {rows.shape[1]} numbers; expected 12 (KITTI) or 8 (TUM) a scan")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    if rows.shape[1] == 8:
        poses[:, :3, :3] = quaternion.to_matrix(quaternion.normalize(rows[:, [7, 4, 5, 6]]))
        poses[:, :3, 3] = rows[:, 1:4]
    else:
        poses[:, :3] = rows.reshape(len(rows), -1, 4)[:, :3]
        poses[np.isnan(rows).any(axis=1)] = np.nan
    return list(poses)
