"""The trajectory of a run: gaps bridged, written and read as KITTI or TUM, written as a pose graph (g2o)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import numpy as np

from dqreg._arrays import FloatArray, IntArray, as_float
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.g2o import to_g2o
from dqreg.files.trajectories import Form, Gaps, form_by_name, found_rows, read_poses, to_kitti, to_tum
from dqreg.rigid import Trajectory
from dqreg.rigid.single_pose import orthonormal
from dqreg.rigid.twist import TRANSLATION_FIRST

# Information that is written of a motion of which nothing is known.
UNKNOWN_INFORMATION = 1e-9


def bridge_gaps(poses: Any) -> tuple[FloatArray, IntArray]:
    """A trajectory without gaps, for formats that need a line a frame.

    Parameters
    ----------
    poses : array_like, (n, 4, 4)
        Poses of the frames; NaN where none was found.

    Returns
    -------
    bridged : ndarray, (n, 4, 4)
        The same, with poses between those beside a gap; before the first one found and after the last, that one.
    missing : ndarray, (k,)
        Numbers of the frames without a pose, from 0.

    Raises
    ------
    InputError
        If the shape is wrong, or no frame has a pose.

    Examples
    --------
    >>> path = np.stack([np.eye(4)] * 3)
    >>> path[1], path[2, 0, 3] = np.nan, 4.0
    >>> bridged, missing = bridge_gaps(path)
    >>> bridged[:, 0, 3].tolist(), missing.tolist()
    ([0.0, 2.0, 4.0], [1])
    """
    poses = as_float(poses, "poses")
    if poses.shape[-2:] != (4, 4):
        raise InputError(f"poses must be (n, 4, 4), NaN where none was found; got the shape {poses.shape}")
    poses = poses.reshape(-1, 4, 4)
    found = np.flatnonzero(found_rows(poses))
    if not len(found):
        raise InputError(f"none of the {len(poses)} frames was placed; there is no trajectory")
    bridged = poses.copy()
    missing = np.setdiff1d(np.arange(len(poses)), found)
    if len(missing):
        path = Trajectory(found.astype(np.float64), np.stack([orthonormal(T) for T in poses[found]]))
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
        The format. TUM and g2o leave frames without a pose out; KITTI, which counts lines, bridges them. TUM's lines
        are in the order of their times, as its readers ask, also where frames came in another one.

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
    form = _checked_form(path, form)
    if isinstance(poses, Trajectory):
        poses, times = poses.poses, poses.times if times is None else times
    bridged, missing = bridge_gaps(poses)
    stamps = np.arange(len(bridged), dtype=float) if times is None else as_float(times, "times").ravel()
    if len(stamps) != len(bridged):
        raise InputError(f"times must be one a frame; got {len(stamps)} for {len(bridged)} frames")
    placed = np.setdiff1d(np.arange(len(bridged)), missing)
    if form == "g2o":
        spread = None if covariances is None else as_float(covariances, "covariances").reshape(-1, 6, 6)
        if spread is not None and len(spread) != len(bridged):
            raise InputError(f"covariances must be one a frame; got {len(spread)} for {len(bridged)} frames")
        text = _graph(placed, bridged[placed], None if spread is None else spread[placed])
    elif form == "tum":
        in_time = placed[np.argsort(stamps[placed], kind="stable")]
        text = to_tum(bridged[in_time], stamps[in_time])
    else:
        text = to_kitti(bridged)
    write_atomically(path, text)
    return form


def _checked_form(path: str | Path, form: str | None) -> str:
    if form is not None and form not in get_args(Form):
        raise InputError(f"unknown trajectory format {form!r}; known are {', '.join(get_args(Form))}")
    return form or form_by_name(path)


def read_trajectory(path: str | Path, *, gaps: Gaps = "refuse") -> tuple[FloatArray, FloatArray | None]:
    """Read a trajectory in either format; the number of columns tells which.

    Parameters
    ----------
    path : str or Path
        KITTI (12 or 16 numbers a line) or TUM (8).
    gaps : {"refuse", "keep"}
        What to do with lines of NaN, as `Multiway.save` writes for a scan that is not placed: raise, or return NaN
        there, which `bridge_gaps` and `evaluate` take.

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

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "a.tum").write_text("0.5 1 2 3 0 0 0 1")  # t x y z qx qy qz qw
    ...     poses, times = read_trajectory(f"{folder}/a.tum")
    >>> poses[:, :3, 3].tolist(), times.tolist()
    ([[1.0, 2.0, 3.0]], [0.5])
    """
    if gaps not in get_args(Gaps):
        raise InputError(f'gaps must be "refuse" or "keep"; got {gaps!r:.60}')
    return read_poses(path, gaps)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory in KITTI's or TUM's format; the number of columns tells which.

    Parameters
    ----------
    path : str or Path
        KITTI (12 or 16 numbers a line) or TUM (8).

    Returns
    -------
    Trajectory
        KITTI has no times: the numbers of the lines, from 0, stand in. Lines of NaN are left out, as TUM does.

    Raises
    ------
    InputError
        If the file is missing or holds something else, or TUM's times do not increase.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "a.txt").write_text("1 0 0 5 0 1 0 6 0 0 1 7")  # KITTI: three rows of a pose
    ...     path = load_trajectory(f"{folder}/a.txt")
    >>> path.times.tolist(), path.poses[0, :3, 3].tolist()
    ([0.0], [5.0, 6.0, 7.0])
    """
    poses, times = read_poses(path, "keep")
    found = found_rows(poses)
    try:
        return Trajectory((np.arange(float(len(poses))) if times is None else times)[found], poses[found])
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _graph(numbers: IntArray, poses: FloatArray, covariances: FloatArray | None) -> str:
    """The placed frames and the steps between them as a g2o file.

    Covariances are of left increments about the sensors in the map's axes, rotation first; a step is as uncertain as
    the later frame is in the map. Shapes: numbers (n,), poses (n, 4, 4), covariances (n, 6, 6).
    """
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    information = np.tile(np.eye(6), (len(steps), 1, 1))
    if covariances is not None:
        for k in range(len(steps)):
            information[k] = _information(poses[k + 1, :3, :3], covariances[k + 1])
    pairs = np.stack([numbers[:-1], numbers[1:]], axis=1)
    return to_g2o(numbers, poses, int(numbers[0]), pairs, steps, information)


def _information(R: FloatArray, covariance: FloatArray) -> FloatArray:
    """Information of a right increment in the sensor's axes, translation first."""
    if not np.isfinite(covariance).all() or not covariance.any():
        return UNKNOWN_INFORMATION * np.eye(6)
    axes = np.kron(np.eye(2), R)
    found = np.asarray(np.linalg.pinv(axes.T @ covariance @ axes, hermitian=True), dtype=np.float64)
    shifted: FloatArray = found[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)]
    return shifted
