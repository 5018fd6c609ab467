"""Pairs of poses on disk, for hand-eye calibration: JSON, or a table with both poses in each row."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.files.untrusted import read_record, require_readable
from dqreg.rigid import pose, quaternion

KEYS = ("hand", "eye")
# Norms of quaternions that were written with few digits.
UNIT_TOLERANCE = 1e-3
EXPECTED = (
    'JSON {"hand": [4x4, ...], "eye": [4x4, ...]}, or rows with both poses: 14 numbers (x y z qx qy qz qw, twice), '
    "24 or 32 (matrices row by row)"
)


def read_pose_pairs(path: str | os.PathLike[str]) -> tuple[FloatArray, FloatArray]:
    """Poses of the hand and of the eye as they stand in the file, (n, 4, 4) each."""
    path = require_readable(path, "pairs of poses")
    text = read_record(path, "pairs of poses")
    if path.suffix.lower() == ".json" or text.lstrip()[:1] in ("{", "["):
        return _from_json(path, text)
    lines = [line for line in text.replace(",", " ").replace(";", " ").splitlines() if _is_numbers(line)]
    try:
        rows = np.loadtxt(lines, ndmin=2) if lines else np.zeros((0, 14))
    except ValueError as error:
        raise InputError(f"cannot read {path}: {str(error).split(';')[0]}; expected {EXPECTED}") from error
    if not len(rows):
        raise InputError(f"{path} holds no row of numbers; expected {EXPECTED}")
    if rows.shape[1] not in (14, 24, 32):
        raise InputError(f"{path} has {rows.shape[1]} numbers a row; expected {EXPECTED}")
    half = rows.shape[1] // 2
    return _poses(rows[:, :half], path), _poses(rows[:, half:], path)


def _is_numbers(line: str) -> bool:
    # A line of column names is left out, and so are comments.
    first = line.split("#")[0].split()
    if not first:
        return False
    try:
        float(first[0])
    except ValueError:
        return False
    return True


def _from_json(path: Path, text: str) -> tuple[FloatArray, FloatArray]:
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"cannot read {path}: {error}") from error
    if not isinstance(data, dict) or any(key not in data for key in KEYS):
        raise InputError(f"{path} must be an object with the keys hand and eye; expected {EXPECTED}")
    if not any(data[key] for key in KEYS):
        raise InputError(f"{path}: no stations are given: hand and eye are empty; three are needed, better ten")
    hand, eye = (as_float(data[key], f"{path}: {key}") for key in KEYS)
    for key, side in zip(KEYS, (hand, eye), strict=True):
        if side.ndim != 3 or side.shape[1:] != (4, 4):
            raise InputError(f"{path}: {key} must be a list of 4x4 matrices; got shape {side.shape}")
    if len(hand) != len(eye):
        raise InputError(
            f"{path} holds {len(hand)} poses of the hand and {len(eye)} of the eye; give one of each a row"
        )
    return hand, eye


def _poses(rows: FloatArray, path: Path) -> FloatArray:
    if rows.shape[1] == 7:
        q = np.roll(rows[:, 3:], 1, axis=1)
        lengths = np.linalg.norm(q, axis=1)
        if not (np.abs(lengths - 1.0) <= UNIT_TOLERANCE).all():
            raise InputError(
                f"{path}: quaternions must have length 1, scalar last; lengths run from {lengths.min():.4g} to "
                f"{lengths.max():.4g}. Are the columns x y z qx qy qz qw?"
            )
        return pose.from_parts(quaternion.to_matrix(q / lengths[:, None]), rows[:, :3])
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses.reshape(len(rows), 16)[:, : rows.shape[1]] = rows
    return poses
