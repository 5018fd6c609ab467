"""Trajectories on disk: KITTI (twelve numbers a line) and TUM (time, place, quaternion x y z w)."""

from __future__ import annotations

import csv
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, as_float
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.untrusted import read_record
from dqreg.odometry.engines import TrajectoryRun
from dqreg.odometry.kiss import rigid
from dqreg.odometry.scans import Scans
from dqreg.registration.result import Registration
from dqreg.rigid import DualQuaternion, quaternion

FORMATS = ("kitti", "tum")


def found_rows(poses: FloatArray) -> BoolArray:
    """Which poses were found, (n,). Shapes: poses (n, 4, 4)."""
    return np.asarray(np.isfinite(poses).all(axis=(1, 2)))


def bridge_gaps(poses: Any) -> tuple[FloatArray, IntArray]:
    """A trajectory without gaps, for formats that need a line a frame. Shapes: poses (n, 4, 4), bridged (n, 4, 4)."""
    poses = as_float(poses, "poses").reshape(-1, 4, 4)
    found = np.flatnonzero(found_rows(poses))
    if not len(found):
        raise InputError(f"none of the {len(poses)} frames was placed; there is no trajectory")
    bridged = poses.copy()
    missing = np.setdiff1d(np.arange(len(poses)), found)
    for row in missing:
        after = int(np.searchsorted(found, row))
        if after in (0, len(found)):
            bridged[row] = poses[found[min(after, len(found) - 1)]]
            continue
        first, last = found[after - 1], found[after]
        ends = [DualQuaternion.from_matrix(rigid(poses[i])) for i in (first, last)]
        bridged[row] = ends[0].sclerp(ends[1], float((row - first) / (last - first))).as_matrix()
    return bridged, missing


def write_trajectory(path: str | Path, poses: Any, times: Any = None, form: str | None = None) -> str:
    r"""Write a trajectory, whole or not at all.

    Parameters
    ----------
    path : str or Path
        File to write.
    poses : array_like, (n, 4, 4)
        Poses T_map_frame; NaN where none was found.
    times : array_like, (n,), optional
        Time of each frame, seconds; the frame numbers where there are none.
    form : {"kitti", "tum"}, optional
        Default: TUM for names that end in ``.tum`` or ``_tum.txt``, else KITTI.

    Returns
    -------
    str
        The format. TUM leaves frames without a pose out; KITTI, which counts lines, bridges them.

    Raises
    ------
    InputError
        If the format is unknown, the numbers of poses and times differ, nothing was found, or the file cannot be
        written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_trajectory(f"{folder}/a.tum", [np.eye(4)], [0.5]), (Path(folder) / "a.tum").read_text()
    ('tum', '0.500000000 0.0 0.0 0.0 0.0 0.0 0.0 1.0\n')
    """
    path = Path(path)
    form = form or ("tum" if path.suffix == ".tum" or path.stem.endswith("_tum") else "kitti")
    if form not in FORMATS:
        raise InputError(f"unknown trajectory format {form!r}; known are {', '.join(FORMATS)}")
    bridged, missing = bridge_gaps(poses)
    if form == "kitti":
        lines = [" ".join(map(repr, row.ravel().tolist())) for row in bridged[:, :3]]
    else:
        stamps = np.arange(len(bridged), dtype=float) if times is None else as_float(times, "times").ravel()
        if len(stamps) != len(bridged):
            raise InputError(f"times must be one a frame; got {len(stamps)} for {len(bridged)} frames")
        keep = np.setdiff1d(np.arange(len(bridged)), missing)
        lines = [_tum_line(stamps[i], bridged[i]) for i in keep]
    write_atomically(path, "\n".join(lines) + "\n")
    return form


def _tum_line(time: float, T: FloatArray) -> str:
    w, x, y, z = quaternion.from_matrix(T[:3, :3]).tolist()
    return " ".join([f"{time:.9f}", *map(repr, [*T[:3, 3].tolist(), x, y, z, w])])


def read_trajectory(path: str | Path) -> tuple[FloatArray, FloatArray | None]:
    """Read a trajectory in either format; the number of columns tells which.

    Parameters
    ----------
    path : str or Path
        KITTI (12 or 16 numbers a line) or TUM (8).

    Returns
    -------
    poses : ndarray, (n, 4, 4)
        Rigid to the last digit.
    times : ndarray, (n,) or None
        None for KITTI.

    Raises
    ------
    InputError
        If it is missing or holds something else.
    """
    lines = read_record(path, "a trajectory").splitlines()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of a file without rows
            rows = np.loadtxt(lines, ndmin=2)
    except (ValueError, UserWarning) as error:
        raise InputError(f"cannot read the trajectory {path}: {error}") from error
    if not rows.size or rows.shape[1] not in (8, 12, 16) or not np.isfinite(rows).all():
        raise InputError(
            f"{path} is no trajectory: lines of {rows.shape[1]} numbers; expected finite numbers, 12 (KITTI) or 8 (TUM)"
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    times = None
    if rows.shape[1] == 8:
        times, w_first = rows[:, 0], rows[:, [7, 4, 5, 6]]
        length = np.linalg.norm(w_first, axis=1, keepdims=True)
        if not (length > 0.5).all():
            raise InputError(f"{path}: a quaternion of length {length.min():.3g}; expected unit quaternions x y z w")
        poses[:, :3, :3], poses[:, :3, 3] = quaternion.to_matrix(w_first / length), rows[:, 1:4]
    else:
        poses[:, :3] = rows.reshape(len(rows), -1, 4)[:, :3]
    gap = np.abs(poses[:, :3, :3].transpose(0, 2, 1) @ poses[:, :3, :3] - np.eye(3)).max()
    if gap > 1e-2 or not (np.linalg.det(poses[:, :3, :3]) > 0.0).all():
        raise InputError(f"{path}: a rotation block departs from a rotation by {gap:.3g}; expected rigid poses")
    return np.stack([rigid(T) for T in poses]), times


HEADER = (
    "frame",
    "name",
    "time",
    "level",
    "x",
    "y",
    "z",
    "sigma_turn_deg",
    "sigma_shift",
    "on_map",
    "rms",
    "seconds",
    "reasons",
)


def write_frames(path: str | Path, trip: TrajectoryRun, scans: Scans) -> None:
    """Write verdict, place, one-sigmas and reasons of every frame as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for number, name in enumerate(scans.names):
        time = "" if scans.times is None else f"{scans.times[number]:.9f}"
        place = [_number(value) for value in trip.poses[number, :3, 3]]
        words = [""] * 6
        if trip.results:
            result = trip.results[number]
            words = [
                result.verdict.level,
                *(_number(value) for value in (*_sigmas(result), result.inlier_fraction, result.rms)),
                "; ".join(result.verdict.reasons),
            ]
        row = [number, name, time, words[0], *place, *words[1:5], _number(trip.seconds[number]), words[5]]
        writer.writerow(row)
    write_atomically(Path(path), text.getvalue())


def to_records(trip: TrajectoryRun, scans: Scans) -> list[dict[str, Any]]:
    """The frames as plain values."""
    records = []
    for number, name in enumerate(scans.names):
        result = trip.results[number] if trip.results else None
        turn, shift = (None, None) if result is None else _sigmas(result)
        records.append(
            {
                "frame": number,
                "name": name,
                "time": None if scans.times is None else float(scans.times[number]),
                "level": None if result is None else result.verdict.level,
                "T_target_source": trip.poses[number],
                "sigma_turn_deg": turn,
                "sigma_shift": shift,
                "on_map": None if result is None else result.inlier_fraction,
                "rms": None if result is None else result.rms,
                "seconds": float(trip.seconds[number]),
                "reasons": [] if result is None else list(result.verdict.reasons),
                "codes": [] if result is None else list(result.verdict.codes),
            }
        )
    return records


def _sigmas(result: Registration) -> tuple[float, float]:
    """One sigma of the turn in degrees and of the shift."""
    turn, shift = (float(np.sqrt(np.trace(result.covariance[part, part]))) for part in (slice(3), slice(3, 6)))
    return float(np.rad2deg(turn)), shift


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
