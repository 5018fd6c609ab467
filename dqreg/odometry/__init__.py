"""Scan-to-map odometry: a LiDAR sequence becomes a trajectory, with a verdict and a covariance for every frame.

`Odometry` takes frames one by one. The adaptive threshold is KISS-ICP's own (package ``kiss-icp``), the map takes the
points that its map does; the pose is found on planes of the map's cells, or by the steps of `dqreg.icp`.
"""

from __future__ import annotations

from dqreg.odometry.deskewing import deskew
from dqreg.odometry.evaluation import Errors, evaluate, nees
from dqreg.odometry.odometry import Odometry
from dqreg.odometry.settings import OdometrySettings
from dqreg.odometry.trajectory import bridge_gaps, load_trajectory, read_trajectory, write_trajectory

__all__ = [
    "Errors",
    "Odometry",
    "OdometrySettings",
    "bridge_gaps",
    "deskew",
    "evaluate",
    "load_trajectory",
    "nees",
    "read_trajectory",
    "write_trajectory",
]
