"""Trajectories on disk: KITTI (the twelve numbers of a 3x4 pose a line) and TUM (time, position, quaternion x y z w).

A pose that was not found is NaN. KITTI counts lines, so it stands there as a line of NaN; TUM leaves it out, and the
times tell.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg._rotations import nearest_rotation
from dqreg.errors import InputError
from dqreg.files.untrusted import read_record

Form = Literal["kitti", "tum", "g2o"]
# What a reader does with poses that were not found: refuse the file, or keep them as NaN.
Gaps = Literal["refuse", "keep"]
# Farther from a rotation than this, nothing is one; nearer than that, it is one to the last digit and stays as it is.
NO_ROTATION, ROTATION_ROUNDING = 1e-2, 1e-14


def found_rows(poses: FloatArray) -> BoolArray:
    """Which poses were found, (n,). Shapes: poses (n, 4, 4)."""
    return np.asarray(np.isfinite(poses).all(axis=(1, 2)))


def form_by_name(path: str | Path) -> Form:
    """Format that the name of a file stands for.

    >>> [form_by_name(name) for name in ("a.txt", "a.tum", "a_tum.txt", "a.g2o")]
    ['kitti', 'tum', 'tum', 'g2o']
    """
    suffix, stem = Path(path).suffix.lower(), Path(path).stem.lower()
    if suffix == ".g2o":
        return "g2o"
    return "tum" if suffix == ".tum" or stem.endswith("_tum") else "kitti"


def to_kitti(poses: FloatArray) -> str:
    """A line a pose; of NaN where it was not found. Shapes: poses (n, 4, 4)."""
    return "".join(" ".join(map(repr, T[:3].ravel().tolist())) + "\n" for T in poses)


def to_tum(poses: FloatArray, times: FloatArray) -> str:
    """A line a pose that was found. Shapes: poses (n, 4, 4), times (n,)."""
    found = found_rows(poses)
    places = positions_and_quaternions(poses[found])
    return "".join(f"{time:.9f} {place}\n" for time, place in zip(times[found], places, strict=True))


def positions_and_quaternions(poses: FloatArray) -> list[str]:
    """Seven numbers of each pose, the scalar of the quaternion last and not negative. Shapes: poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    rotations = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    return [" ".join(map(repr, row)) for row in np.hstack([poses[:, :3, 3], rotations]).tolist()]


def read_poses(
    path: str | Path, gaps: Gaps = "refuse", wanted: str = "a trajectory"
) -> tuple[FloatArray, FloatArray | None]:
    """Poses of a file, rigid to the last digit, and its times; None for KITTI. Shapes: poses (n, 4, 4), times (n,)."""
    rows = _rows(path, wanted)
    times = None
    if rows.shape[1] == 8:
        times, numbers = rows[:, 0], rows[:, 1:]
    else:
        numbers = rows[:, :12]
    found = ~np.isnan(numbers).all(axis=1)
    if not np.isfinite(rows[found]).all() or not (times is None or np.isfinite(times).all()):
        raise InputError(f"cannot read {path} as {wanted}: expected finite numbers, or NaN for a pose not found")
    if gaps == "refuse" and not found.all():
        missing = int(np.flatnonzero(~found)[0])
        raise InputError(
            f"{path}: pose {missing} (from 0) was not found: its line is NaN. Leave such lines out, or read the file "
            'with gaps="keep", where they stay NaN'
        )
    poses = np.full((len(rows), 4, 4), np.nan)
    poses[found] = _rigid(numbers[found], path)
    return poses, times


def _rows(path: str | Path, wanted: str) -> FloatArray:
    lines = read_record(path, wanted).splitlines()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of a file without rows
            rows = np.loadtxt(lines, ndmin=2)
    except (ValueError, UserWarning) as error:
        raise InputError(f"cannot read {path} as {wanted}: {error}") from error
    if not rows.size or rows.shape[1] not in (8, 12, 16):
        raise InputError(
            f"cannot read {path} as {wanted}: lines of {rows.shape[1]} numbers; expected 12 (KITTI) or 8 (TUM) a pose"
        )
    return np.asarray(rows)


def _rigid(numbers: FloatArray, path: str | Path) -> FloatArray:
    """Poses of rows of 12 or 7 numbers, (n, 4, 4)."""
    poses = np.tile(np.eye(4), (len(numbers), 1, 1))
    if not len(numbers):
        return poses
    if numbers.shape[1] == 7:
        poses[:, :3, :3], poses[:, :3, 3] = _rotations(numbers[:, 3:], path), numbers[:, :3]
    else:
        poses[:, :3] = numbers.reshape(-1, 3, 4)
    R = poses[:, :3, :3]
    # What overflows is no rotation.
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2))
    if not (off <= NO_ROTATION).all() or not (np.linalg.det(R) > 0.0).all():
        raise InputError(f"{path}: a rotation block departs from a rotation by {off.max():.3g}; expected rigid poses")
    rounded = off > ROTATION_ROUNDING
    poses[rounded, :3, :3] = nearest_rotation(R[rounded])
    return poses


def _rotations(w_last: FloatArray, path: str | Path) -> FloatArray:
    from scipy.spatial.transform import Rotation

    with np.errstate(over="ignore"):
        length = np.linalg.norm(w_last, axis=1, keepdims=True)
    if not ((length > 0.5) & (length < 1e3)).all():
        worst = float(length[np.argmax(np.abs(length - 1.0))][0])
        raise InputError(f"{path}: a quaternion of length {worst:.3g}; expected unit quaternions x y z w")
    return np.asarray(Rotation.from_quat(w_last).as_matrix(), dtype=np.float64)
