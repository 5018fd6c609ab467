"""KITTI's frames: four float32 a point (x, y, z, reflectance), in metres, with the sensor at the origin.

nuScenes' frames, whose names end in .pcd.bin, have a fifth, the ring. Nothing in a file tells the two apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.cloud_data import CloudData, SweepData, make_cloud
from dqreg.files.untrusted import require_readable, unreadable

# Metres that no LiDAR measures: other binary files hold such numbers, read as float32.
MAX_RANGE_M = 1e5
# How the names of nuScenes' frames end.
NUSCENES = ".pcd.bin"


def kitti_rows(path: Path) -> FloatArray:
    """Points of a frame as they stand in the file, finite or not, (n, 3)."""
    raw = require_readable(path).read_bytes()
    width = 5 if path.name.lower().endswith(NUSCENES) else 4
    if len(raw) % (4 * width):
        expected = "KITTI's frames: four float32 (x, y, z, intensity) a point, 16 bytes"
        if width == 5:
            expected = "nuScenes' frames: five float32 (x, y, z, intensity, ring) a point, 20 bytes"
        raise unreadable(path, f"{len(raw)} bytes", expected)
    # The cast of a signalling NaN warns; as any NaN it is dropped and counted later.
    with np.errstate(invalid="ignore"):
        points = np.frombuffer(raw, dtype="<f4").reshape(-1, width)[:, :3].astype(np.float64)
    known = np.abs(points[np.isfinite(points)])
    if known.size and known.max() > MAX_RANGE_M:
        found = f"coordinates up to {known.max():.3g} when read as {width} float32 a point"
        raise unreadable(path, found, "metres from the sensor; save the points of another layout as .npy")
    return points


def read_kitti(path: Path) -> CloudData:
    """Cloud of a KITTI frame."""
    return SweepData(**vars(make_cloud(path, kitti_rows(path), viewpoint=np.zeros(3), units="m")))
