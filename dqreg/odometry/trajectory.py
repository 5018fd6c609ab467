"""Trajectories on disk: KITTI (twelve numbers a line) and TUM (time, place, quaternion x y z w)."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, as_float
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.odometry.engines import TrajectoryRun
from dqreg.odometry.kiss import rigid
from dqreg.odometry.scans import Scans
from dqreg.odometry.trajectory_files import form_of, graph_of, read_poses, text_of
from dqreg.registration.result import Registration
from dqreg.rigid import Trajectory


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
    if len(missing):
        path = Trajectory(found.astype(np.float64), np.stack([rigid(T) for T in poses[found]]))
        inside = missing[(missing > found[0]) & (missing < found[-1])]
        bridged[inside] = path.at(inside)
        bridged[: found[0]], bridged[found[-1] :] = poses[found[0]], poses[found[-1]]
    return bridged, missing


def write_trajectory(
    path: str | Path, poses: Any, times: Any = None, form: str | None = None, *, covariances: Any = None
) -> str:
    r"""Write a trajectory, whole or not at all.

    Parameters
    ----------
    path : str or Path
        File to write.
    poses : array_like, (n, 4, 4), or Trajectory
        Poses T_map_frame; NaN where none was found. A `dqreg.Trajectory` brings its times.
    times : array_like, (n,), optional
        Time of each frame, seconds; the frame numbers where there are none.
    form : {"kitti", "tum", "g2o"}, optional
        Default: TUM for names that end in ``.tum`` or ``_tum.txt``, g2o for ``.g2o``, else KITTI.
    covariances : array_like, (n, 6, 6), optional
        For g2o: of each pose, as the results of `Odometry` have them. Without, every step weighs the same.

    Returns
    -------
    str
        The format. TUM and g2o leave frames without a pose out; KITTI, which counts lines, bridges them.

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
    form = form_of(path, form)
    if isinstance(poses, Trajectory):
        poses, times = poses.poses, poses.times if times is None else times
    bridged, missing = bridge_gaps(poses)
    stamps = np.arange(len(bridged), dtype=float) if times is None else as_float(times, "times").ravel()
    if len(stamps) != len(bridged):
        raise InputError(f"times must be one a frame; got {len(stamps)} for {len(bridged)} frames")
    if form == "g2o":
        placed = np.setdiff1d(np.arange(len(bridged)), missing)
        spread = None if covariances is None else as_float(covariances, "covariances").reshape(-1, 6, 6)
        if spread is not None and len(spread) != len(bridged):
            raise InputError(f"covariances must be one a frame; got {len(spread)} for {len(bridged)} frames")
        write_atomically(path, graph_of(placed, bridged[placed], None if spread is None else spread[placed]))
        return form
    keep = np.setdiff1d(np.arange(len(bridged)), missing if form == "tum" else ())
    write_atomically(path, text_of(bridged[keep], stamps[keep], form))
    return form


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
    return read_poses(path)


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
