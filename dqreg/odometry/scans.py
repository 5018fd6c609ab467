"""The frames of a sequence: a folder of scans, an archive of them, or what one of KISS-ICP's data loaders reads."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_vectors
from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_cloud
from dqreg.odometry.kiss import load_kiss

# What a frame may be in a folder of them; text files beside the scans are poses and times.
KINDS = (".bin", ".csv", ".npy", ".npz", ".pcd", ".ply", ".xyz")
# Names under which files and archives keep the time of each point.
TIME_FIELDS = ("t", "timestamp", "timestamps", "time", "times", "stamps")


@dataclasses.dataclass(frozen=True)
class FrameData:
    """One frame as it was read."""

    points: FloatArray  # (n, 3): Points, perhaps not finite; n is 0 where the frame could not be read
    timestamps: FloatArray | None = None  # (n,): Time of each point
    problem: str | None = None  # Why it could not be read


@dataclasses.dataclass(frozen=True)
class Scans:
    """A sequence, read frame by frame."""

    names: tuple[str, ...]  # Name of each frame
    read: Callable[[int], FrameData]  # From the frame's number to its data; raises `InputError` where it cannot be read
    times: FloatArray | None = None  # (n,): Time of each frame, seconds
    truth: FloatArray | None = None  # (n, 4, 4): True poses of the sensor, where a data loader knows them
    # From poses of the sensor to those that the data set's own files hold (KITTI's camera), (n, 4, 4) to the same
    calibrate: Callable[[FloatArray], FloatArray] | None = None

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, number: int) -> FrameData:
        """A frame; where it cannot be read, an empty one that says why."""
        try:
            return self.read(number)
        except InputError as error:
            return FrameData(np.zeros((0, 3)), None, str(error))


def open_scans(
    path: str | Path, times: str | Path | None = None, loader: str | None = None, sequence: str | None = None
) -> Scans:
    """Find the frames of a sequence."""
    path = Path(path)
    if not path.exists():
        raise InputError(f"cannot read {path}: no such file or folder; expected a folder of scans or an .npz sequence")
    if loader is not None:
        scans = _from_loader(path, loader, sequence)
    elif path.is_dir():
        scans = _from_folder(path)
    elif path.suffix.lower() == ".npz":
        scans = _from_archive(path)
    else:
        raise InputError(f"{path} is one file; odometry needs a folder of scans or an .npz with points and offsets")
    beside = (path if path.is_dir() else path.parent) / "times.txt"
    file = Path(times) if times is not None else beside if beside.is_file() and loader is None else None
    if file is None:
        return scans
    stamps = _read_times(file)
    if len(stamps) != len(scans):
        raise InputError(f"{file} holds {len(stamps)} times for {len(scans)} frames; one line a frame is needed")
    return dataclasses.replace(scans, times=stamps)


def _read_times(file: Path) -> FloatArray:
    try:
        return np.loadtxt(file, ndmin=1, dtype=np.float64).reshape(-1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read the times {file}: {error}") from error


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", path.name)]


def _from_folder(folder: Path) -> Scans:
    files = [file for file in folder.iterdir() if file.suffix.lower() in KINDS]
    if len(files) == 1 and files[0].suffix.lower() == ".npz":
        return _from_archive(files[0])
    # A folder with poses and notes beside the scans: the most frequent kind is the scans.
    suffixes = [file.suffix.lower() for file in files]
    if not files:
        raise InputError(f"{folder} holds no scans; known are {', '.join(KINDS)}")
    kind = max(sorted(set(suffixes)), key=suffixes.count)
    chosen = sorted((file for file in files if file.suffix.lower() == kind), key=_natural)
    return Scans(tuple(file.name for file in chosen), lambda number: _read_file(chosen[number]))


def _read_file(file: Path) -> FrameData:
    kind = file.suffix.lower()
    if kind == ".bin":
        try:
            raw = file.read_bytes()
        except OSError as error:
            raise InputError(f"cannot read {file}: {error}") from error
        if len(raw) % 16:
            raise InputError(
                f"{file} has {len(raw)} bytes; KITTI's frames are four float32 (x, y, z, intensity) a point"
            )
        return FrameData(np.frombuffer(raw, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64))
    if kind == ".npz":
        with _archive(file) as archive:
            if "points" not in archive:
                raise InputError(f"{file} holds {', '.join(archive) or 'nothing'}; expected an array named points")
            times = next((archive[name] for name in TIME_FIELDS if name in archive), None)
            return FrameData(as_vectors(archive["points"], "points", finite=False), _stamps(times))
    if kind in (".ply", ".pcd") and _has_times(file):
        cloud = load_open3d().t.io.read_point_cloud(str(file))
        name = next((name for name in TIME_FIELDS if name in cloud.point), None)
        if name is not None and "positions" in cloud.point:
            return FrameData(cloud.point.positions.numpy().astype(np.float64), _stamps(cloud.point[name].numpy()))
    return FrameData(read_cloud(file).points)


def _has_times(file: Path) -> bool:
    with file.open("rb") as stream:
        head = stream.read(2048).lower()
    return any(re.search(rb"\b" + name.encode() + rb"\b", head) for name in TIME_FIELDS)


def _stamps(times: Any) -> FloatArray | None:
    return None if times is None else np.asarray(times, dtype=np.float64).reshape(-1)


def _archive(file: Path) -> Any:
    try:
        return np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"cannot read {file}: {error}") from error


def _from_archive(file: Path) -> Scans:
    with _archive(file) as archive:
        if not {"points", "offsets"} <= set(archive):
            raise InputError(f"{file} holds {', '.join(archive) or 'nothing'}; a sequence needs points and offsets")
        points, offsets = archive["points"], np.asarray(archive["offsets"], dtype=np.int64).reshape(-1)
        scale = float(archive["scale"]) if "scale" in archive else 1.0
        stamps = np.asarray(archive["timestamps"], dtype=np.float64) if "timestamps" in archive else None
        times = np.asarray(archive["times"], dtype=np.float64).reshape(-1) if "times" in archive else None
    sound = len(offsets) > 1 and offsets[0] >= 0 and offsets[-1] <= len(points) and (np.diff(offsets) >= 0).all()
    if not sound or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{file}: offsets must rise from 0 to the number of points, and points be (n, 3)")

    def read(number: int) -> FrameData:
        part = slice(offsets[number], offsets[number + 1])
        return FrameData(points[part].astype(np.float64) * scale, None if stamps is None else stamps[part])

    if times is not None and len(times) != len(offsets) - 1:
        raise InputError(f"{file} holds {len(times)} times for {len(offsets) - 1} frames")
    return Scans(tuple(f"{file.name}[{i}]" for i in range(len(offsets) - 1)), read, times)


def _from_loader(path: Path, loader: str, sequence: str | None) -> Scans:
    datasets = load_kiss("datasets")
    known = datasets.available_dataloaders()
    if loader not in known:
        raise InputError(f"unknown data loader {loader!r}; KISS-ICP has {', '.join(known)}")
    try:
        # The loaders talk to the screen, and some leave the program where a package is missing.
        with contextlib.redirect_stdout(io.StringIO()) as said, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a loader that is not asked for has a bad escape in its source
            data = datasets.dataset_factory(loader, data_dir=path, sequence=sequence, meta=None, topic=None)
    except (Exception, SystemExit) as error:
        words = " ".join([*str(said.getvalue()).split(), str(error)]).strip()
        raise InputError(f"KISS-ICP's data loader {loader!r} cannot read {path}: {words}") from error

    def read(number: int) -> FrameData:
        try:
            points, stamps = data[number]
        except Exception as error:
            raise InputError(f"KISS-ICP's data loader {loader!r} cannot read frame {number}: {error}") from error
        return FrameData(np.asarray(points, dtype=np.float64), _stamps(stamps) if np.size(stamps) else None)

    names = tuple(str(i) for i in range(len(data)))
    if not names:
        raise InputError(f"KISS-ICP's data loader {loader!r} finds no frames in {path}")
    truth = np.asarray(data.gt_poses, dtype=np.float64)[: len(names)] if hasattr(data, "gt_poses") else None
    return Scans(names, read, _loader_times(data, len(names)), truth, getattr(data, "apply_calibration", None))


def _loader_times(data: Any, count: int) -> FloatArray | None:
    try:
        times = np.asarray(data.get_frames_timestamps(), dtype=np.float64).reshape(-1)
    except Exception:
        # Some loaders have none, others promise a file that is not there; the frames are good without.
        return None
    return times if len(times) == count else None
