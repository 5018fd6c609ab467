"""Odometry that never ends: memory, map and accuracy over ten thousand frames."""

from __future__ import annotations

import os

import numpy as np
import psutil
import pytest

pytest.importorskip("kiss_icp")

from dqreg.odometry import Odometry
from dqreg.rigid import pose

FRAMES = int(os.environ.get("DQREG_SOAK_FRAMES", "10000"))
MIB = 1 << 20


def view(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points of a room of 16 x 12 x 5 with a step in its floor, seen from a pose."""
    points = rng.uniform(-1.0, 1.0, (2500, 3)) * [8.0, 6.0, 2.5]
    side = np.arange(2500) % 3
    points[np.arange(2500), side] = np.sign(points[np.arange(2500), side]) * np.array([8.0, 6.0, 2.5])[side]
    points[(points[:, 0] > 3.0) & (points[:, 2] < -2.0), 2] = -2.0
    return pose.apply(pose.inverse(T), points) + rng.normal(0.0, 0.005, points.shape)


@pytest.mark.soak
def test_ten_thousand_frames_take_no_more_memory_than_the_first():
    rng, process = np.random.default_rng(0), psutil.Process()
    odometry, memory, size = Odometry(history=500, threads=1, voxel_size=0.8), [], []
    # A circle a hundred frames long; the map's frame is the room's.
    for number in range(FRAMES):
        angle = 2.0 * np.pi * number / 100
        T = pose.exp([0.0, 0.0, 0.3 * np.sin(angle), 2.0 * np.sin(angle), 1.5 * (1.0 - np.cos(angle)), 0.0])
        result = odometry.register_frame(view(T, rng), stamp=0.1 * number)
        if (number + 1) % max(FRAMES // 20, 1) == 0:
            memory.append(process.memory_info().rss / MIB)
            size.append(len(odometry.local_map))
            # Truth: the pose that the room was seen from; noise 0.005 over hundreds of points.
            assert np.abs(result.T_target_source - T).max() < 0.05
    told = f"memory [MiB] {np.round(memory, 1).tolist()}, points of the map {size}"
    # After a fifth of the frames the room is known; what follows adds nothing.
    assert max(memory[4:]) - memory[3] < 8.0, told
    assert max(size[4:]) <= 1.1 * size[3], told
    assert len(odometry.poses) == min(500, FRAMES)
