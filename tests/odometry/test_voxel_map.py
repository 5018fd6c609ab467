from __future__ import annotations

import functools
import gc
import os
import pickle
import threading
import time
import weakref

import numpy as np
import pytest

from dqreg.kernels import threads
from dqreg.odometry.kiss import load_kiss
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.voxel_map import FORGOTTEN_SHARE, VoxelMap
from dqreg.rigid import pose


def lengths(max_range: float, voxel_size: float = 0.5, most: int = 12) -> Resolved:
    settings = OdometrySettings(max_range=max_range, voxel_size=voxel_size, max_points_per_voxel=most)
    return settings.resolve(np.ones((1, 3)))


def rows(points: np.ndarray) -> set[tuple[float, ...]]:
    return set(map(tuple, points.round(9).tolist()))


@pytest.mark.parametrize("most", [1, 3, pytest.param(12, marks=pytest.mark.soak)])
def test_it_takes_the_points_that_the_map_of_kiss_icp_takes(most: int) -> None:
    rng, given = np.random.default_rng(most), lengths(1e3, most=most)
    ours, theirs = VoxelMap(given), load_kiss("mapping").VoxelHashMap(given.voxel_size, given.max_range, most)
    for step in range(8):
        T = pose.exp(np.array([0.0, 0.0, 0.1 * step, 0.4 * step, 0.0, 0.0]))
        points = rng.uniform(-6, 6, (3_000, 3)) * [1.0, 1.0, 0.2]
        points[:100] = points[100:200]
        ours.insert(functools.partial(np.copy, points), T)
        theirs.update(points, T)
        assert rows(ours.points) == rows(theirs.point_cloud())
        # The surface is that of these points.
        queries = pose.apply(T, points[:50])
        nearest = np.linalg.norm(queries[:, None] - ours.points, axis=2).min(axis=1)
        np.testing.assert_allclose(ours.surface.closest(queries).distances, nearest, atol=1e-12)


def test_a_map_that_is_saved_and_taken_anew_is_the_same() -> None:
    rng, given = np.random.default_rng(0), lengths(1e3)
    first = VoxelMap(given)
    for _ in range(3):
        first.insert(lambda: rng.uniform(-4, 4, (2_000, 3)), np.eye(4))
    np.testing.assert_array_equal(VoxelMap(given, first.points).points, first.points)


def test_room_does_not_follow_the_largest_number_of_a_voxel() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (1_000, 3))
    ours = VoxelMap(lengths(1e3, most=10**12))
    ours.insert(lambda: points, np.eye(4))
    np.testing.assert_array_equal(ours.points, points)


def test_it_forgets_what_is_out_of_range() -> None:
    rng, given = np.random.default_rng(1), lengths(10.0)
    ours = VoxelMap(given)
    for step in range(60):
        T = pose.exp(np.array([0.0, 0.0, 0.0, 0.5 * step, 0.0, 0.0]))
        ours.insert(lambda: rng.uniform(-5, 5, (2_000, 3)), T)
        far = np.linalg.norm(ours.points - T[:3, 3], axis=1) > given.max_range + 2.0 * given.voxel_size
        assert np.mean(far) < 2.0 * FORGOTTEN_SHARE
    assert not (ours.points[:, 0] < 10.0).any()


begun = threading.Event()


def slow_points() -> np.ndarray:
    begun.set()
    time.sleep(0.2)
    return np.random.default_rng(1).uniform(-4, 4, (2_000, 3))


def test_a_copy_of_a_map_that_grows_holds_all_of_it() -> None:
    ours = VoxelMap(lengths(1e3))
    ours.insert(slow_points, np.eye(4))
    taken = pickle.loads(pickle.dumps(ours))
    assert len(taken.points) > 1_000
    np.testing.assert_array_equal(taken.points, ours.points)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_waits_for_a_map_that_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    # With one thread nothing is begun beside.
    monkeypatch.setattr(threads, "thread_count", lambda: 2)
    ours = VoxelMap(lengths(1e3))
    begun.clear()
    ours.insert(slow_points, np.eye(4))
    assert begun.wait(10.0)
    # In another process no thread goes on with it.
    child = os.fork()
    if child == 0:
        os._exit(0 if len(ours.points) > 1_000 else 1)
    deadline = time.monotonic() + 20.0
    while (done := os.waitpid(child, os.WNOHANG)) == (0, 0) and time.monotonic() < deadline:
        time.sleep(0.01)
    if done == (0, 0):
        os.kill(child, 9)
        os.waitpid(child, 0)
    assert done == (child, 0)


def test_a_map_that_grew_is_freed_at_once() -> None:
    ours = VoxelMap(lengths(1e3))
    ours.insert(slow_points, np.eye(4))
    assert ours._added is not None
    ours._added.result()
    known = weakref.ref(ours)
    gc.disable()
    try:
        del ours
        assert known() is None
    finally:
        gc.enable()
