"""What else can run a sequence: KISS-ICP, GenZ-ICP, and small_gicp from scan to scan, behind one call."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import load_package
from dqreg.odometry.frame import read_frame
from dqreg.odometry.kiss import load_kiss
from dqreg.odometry.run_sequence import TrajectoryRun
from dqreg.odometry.scans import Scans
from dqreg.odometry.settings import OdometrySettings
from dqreg.rigid.single_pose import orthonormal


class SequenceEngine(Protocol):
    """Places frames one by one."""

    def place(self, points: FloatArray, timestamps: FloatArray | None) -> FloatArray:
        """Pose of the frame, (4, 4)."""
        ...


class _Pipeline:
    """An odometry of another library that is driven as KISS-ICP's is."""

    _pipeline: Any

    def place(self, points: FloatArray, timestamps: FloatArray | None) -> FloatArray:
        """Pose of the frame, (4, 4); NaN where the frame is empty."""
        frame = read_frame(points, timestamps)
        if not len(frame.points):
            return np.full((4, 4), np.nan)
        self._pipeline.register_frame(frame.points, np.zeros(0) if frame.times is None else frame.times)
        return np.array(self._pipeline.last_pose)


class KissEngine(_Pipeline):
    """KISS-ICP as it comes, kept away from input that ends its process."""

    def __init__(
        self, max_range: float = 100.0, voxel_size: float | None = None, deskew: bool = True, min_range: float = 0.0
    ) -> None:
        config = load_kiss("config").KISSConfig()
        config.data.max_range, config.data.min_range, config.data.deskew = max_range, min_range, deskew
        config.mapping.voxel_size = voxel_size or max_range / 100.0
        self._pipeline = load_kiss("kiss_icp").KissICP(config)


class GenzEngine(_Pipeline):
    """GenZ-ICP as it comes, at the range of the sequence: planar and other points, weighed by how many there are."""

    def __init__(self, max_range: float = 100.0, deskew: bool = True) -> None:
        config = load_package("genz_icp.config", "genz-icp").GenZConfig()
        config.data.max_range, config.data.deskew = max_range, deskew
        self._pipeline = load_package("genz_icp.genz_icp", "genz-icp").GenZICP(config)


class SmallGicpEngine:
    """small_gicp's GICP from each scan to the one before, from constant velocity."""

    def __init__(self, voxel_size: float, reach: float) -> None:
        self._gicp = load_package("small_gicp", "small-gicp")
        self._voxel, self._reach = voxel_size, reach
        self._last: FloatArray | None = None
        self._T, self._motion = np.eye(4), np.eye(4)

    def place(self, points: FloatArray, timestamps: FloatArray | None) -> FloatArray:
        """Pose of the frame, (4, 4); NaN where the frame is empty."""
        finite = read_frame(points, None).points
        if not len(finite):
            return np.full((4, 4), np.nan)
        if self._last is not None:
            found = self._gicp.align(
                self._last,
                finite,
                init_T_target_source=self._motion,
                registration_type="GICP",
                downsampling_resolution=self._voxel,
                max_correspondence_distance=self._reach,
            )
            self._motion = orthonormal(np.array(found.T_target_source))
            self._T = orthonormal(self._T @ self._motion)
        self._last = finite
        return self._T.copy()


def run_engine(
    name: str,
    engine: SequenceEngine,
    scans: Scans,
    tell: Callable[[int], object] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> TrajectoryRun:
    """Run another engine over a sequence, or until ``stop`` says so."""
    poses, seconds = [], []
    for number in range(len(scans)):
        if stop():
            break
        data = scans[number]
        began = time.perf_counter()
        poses.append(engine.place(data.points, data.timestamps))
        seconds.append(time.perf_counter() - began)
        if tell is not None:
            tell(number)
    return TrajectoryRun(name, np.array(poses).reshape(-1, 4, 4), (), np.array(seconds))


def peers(settings: OdometrySettings, first: FloatArray) -> Iterable[tuple[str, Callable[[], Any]]]:
    """Engines to compare with: KISS-ICP as it comes, at its range, at finer voxels; GenZ-ICP; small_gicp scan to scan.

    MAD-ICP publishes no wheels, so it is not among them.
    """
    lengths = settings.resolve(first)
    reach, voxel = lengths.max_range, lengths.voxel_size
    return (
        ("KISS-ICP, defaults", lambda: KissEngine(deskew=settings.deskew)),
        (f"KISS-ICP, range {reach:.4g}", lambda: KissEngine(reach, deskew=settings.deskew)),
        (f"KISS-ICP, voxel {voxel:.3g}", lambda: KissEngine(reach, voxel, settings.deskew)),
        (f"GenZ-ICP, range {reach:.4g}", lambda: GenzEngine(reach, settings.deskew)),
        ("small_gicp, scan to scan", lambda: SmallGicpEngine(0.5 * voxel, lengths.reach)),
    )
