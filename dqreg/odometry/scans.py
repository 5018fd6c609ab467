"""The frames of a sequence: a folder of scans, an archive of them, or what one of KISS-ICP's data loaders reads."""

from __future__ import annotations

import contextlib
import dataclasses
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files import read_cloud
from dqreg.files.cloud_data import TimedCloudData
from dqreg.files.column_names import TIME_NAMES
from dqreg.files.kitti import kitti_rows
from dqreg.files.natural_order import natural_order
from dqreg.files.numpy_files import numbers, read_arrays
from dqreg.files.untrusted import require_readable, unreadable
from dqreg.odometry.bags import CloudTopic, is_bag
from dqreg.odometry.kiss import load_kiss

# What a frame may be in a folder of them; text files beside the scans are poses and times.
FRAME_SUFFIXES = (".bin", ".csv", ".e57", ".las", ".laz", ".npy", ".npz", ".pcd", ".ply", ".pts", ".xyz")

# KISS-ICP's names for its loaders of bags, which give each frame once and drop times out of step: ours reads them.
BAG_LOADERS = ("rosbag", "mcap")


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
    path: str | Path,
    times: str | Path | None = None,
    loader: str | None = None,
    sequence: str | None = None,
    topic: str | None = None,
) -> Scans:
    """Find the frames of a sequence."""
    path = Path(path)
    if not path.exists():
        raise InputError(
            f"cannot read {path}: no such file or folder; expected a folder of scans, a bag or an .npz sequence"
        )
    if loader in BAG_LOADERS or (loader is None and is_bag(path)):
        scans = _from_bag(path, topic)
    elif topic is not None:
        raise InputError(f"--topic names a topic of a bag, and {path} is none")
    elif loader is not None:
        scans = _from_loader(path, loader, sequence)
    elif path.is_dir():
        scans = _from_folder(path)
    elif path.suffix.lower() == ".npz":
        scans = _from_archive(path)
    else:
        raise InputError(
            f"{path} is one file; odometry needs a folder of scans, a bag (.bag, .db3, .mcap), or an .npz with points "
            "and offsets"
        )
    beside = (path if path.is_dir() else path.parent) / "times.txt"
    file = Path(times) if times is not None else beside if beside.is_file() and loader is None else None
    if file is None:
        return scans
    stamps = _read_times(file)
    if len(stamps) != len(scans):
        raise InputError(f"{file} holds {len(stamps)} times for {len(scans)} frames; one line a frame is needed")
    return dataclasses.replace(scans, times=stamps)


def _from_bag(path: Path, topic: str | None) -> Scans:
    clouds = CloudTopic.of(path, topic)

    def read(number: int) -> FrameData:
        found = clouds.read(number)
        return FrameData(found.points, found.times)

    names = tuple(f"{path.name}[{number}]" for number in range(len(clouds.arrivals)))
    # Drivers without a clock leave the stamps zero.
    stamped = bool(np.isfinite(clouds.stamps).all() and np.ptp(clouds.stamps) > 0.0)
    return Scans(names, read, clouds.stamps if stamped else np.array(clouds.arrivals) / 1e9)


def _read_times(file: Path) -> FloatArray:
    try:
        lines = require_readable(file).read_text(encoding="utf-8").splitlines()
        if not any(line.partition("#")[0].strip() for line in lines):
            raise unreadable(file, "no times", "one finite number a line")
        times = np.loadtxt(lines, ndmin=1, dtype=np.float64).reshape(-1)
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read the times {file}: {error}") from error
    if not np.isfinite(times).all():
        raise unreadable(file, "times that are NaN or infinite", "one finite number a line")
    return times


def _from_folder(folder: Path) -> Scans:
    files = [file for file in folder.iterdir() if file.suffix.lower() in FRAME_SUFFIXES]
    suffixes = [file.suffix.lower() for file in files]
    # Beside it may lie what an earlier run wrote, a table of its frames for example.
    if suffixes.count(".npz") == 1 and len(set(suffixes)) == len(suffixes):
        return _from_archive(files[suffixes.index(".npz")])
    # A folder with poses and notes beside the scans: the most frequent kind is the scans.
    if not files:
        raise InputError(f"{folder} holds no scans; known are {', '.join(FRAME_SUFFIXES)}")
    kind = max(sorted(set(suffixes)), key=suffixes.count)
    chosen = sorted((file for file in files if file.suffix.lower() == kind), key=natural_order)
    return Scans(tuple(file.name for file in chosen), lambda number: _read_file(chosen[number]))


def _read_file(file: Path) -> FrameData:
    kind = file.suffix.lower()
    if kind == ".bin":
        return FrameData(kitti_rows(file))
    if kind == ".npz":
        arrays = read_arrays(require_readable(file), ("points", *TIME_NAMES))
        points = numbers(file, arrays["points"], "points", (None, 3))
        name = next((name for name in TIME_NAMES if name in arrays), None)
        return FrameData(points, None if name is None else numbers(file, arrays[name], name, (len(points),)))
    cloud = read_cloud(file)
    return FrameData(cloud.points, cloud.times if isinstance(cloud, TimedCloudData) else None)


def _stamps(times: Any) -> FloatArray | None:
    return None if times is None else np.asarray(times, dtype=np.float64).reshape(-1)


def _from_archive(file: Path) -> Scans:
    arrays = read_arrays(require_readable(file), ("points", "offsets", "scale", "timestamps", "times"))
    if "offsets" not in arrays:
        raise unreadable(file, f"the arrays {', '.join(arrays)}", "a sequence with points and offsets")
    # Packed points are integers of a few bytes; they become float64 frame by frame.
    points = arrays["points"]
    numbers(file, points[:0], "points", (0, 3))
    bounds = numbers(file, arrays["offsets"], "offsets", (None,))
    scale = float(numbers(file, arrays["scale"], "scale", ())) if "scale" in arrays else 1.0
    stamps = numbers(file, arrays["timestamps"], "timestamps", (len(points),)) if "timestamps" in arrays else None
    sound = len(bounds) > 1 and bounds[0] >= 0 and bounds[-1] <= len(points) and (np.diff(bounds) >= 0).all()
    if not sound or (bounds % 1.0 != 0.0).any():
        raise InputError(f"{file}: offsets must be whole and rise from 0 to the number of points")
    if not 0.0 < scale < np.inf:
        raise unreadable(file, f"a scale of {scale:g}", "a positive length a step")
    offsets = bounds.astype(np.int64)
    times = numbers(file, arrays["times"], "times", (len(offsets) - 1,)) if "times" in arrays else None

    def read(number: int) -> FrameData:
        part = slice(offsets[number], offsets[number + 1])
        return FrameData(points[part].astype(np.float64) * scale, None if stamps is None else stamps[part])

    return Scans(tuple(f"{file.name}[{i}]" for i in range(len(offsets) - 1)), read, times)


def _from_loader(path: Path, loader: str, sequence: str | None) -> Scans:
    datasets = load_kiss("datasets")
    known = datasets.available_dataloaders()
    if loader not in known:
        raise InputError(f"unknown data loader {loader!r}; KISS-ICP has {', '.join(known)}")
    try:
        # The loaders talk to the screen, and some leave the program where a package is missing.
        with contextlib.redirect_stdout(io.StringIO()) as said:
            data = datasets.dataset_factory(loader, data_dir=path, sequence=sequence, meta=None, topic=None)
    except (Exception, SystemExit) as error:
        words = " ".join([*str(said.getvalue()).split(), str(error)]).strip()
        hint = "" if sequence else "; data sets of several sequences need --sequence"
        raise InputError(f"KISS-ICP's data loader {loader!r} cannot read {path}: {words}{hint}") from error

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
