"""Where to begin: a few hundred poses are held against the map with a few points each, and the best is refined.

At 2 Hz a hand-held sensor turns by 43 degrees between two frames, and constant velocity is off by 52: neither it nor
standing still is near enough for closest points. A lattice of turns is.
"""

from __future__ import annotations

import functools
from collections import deque

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.spacing import Spread
from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import single_pose, twist

# Points that each pose is judged by; first, all poses by a few.
JUDGING_POINTS, FIRST_JUDGING_POINTS = 150, 30
# The best of these, so many for each that is kept, are judged by all points.
SHORTLIST_PER_KEPT = 10
# Frames over which it is remembered how far predictions were off: who begins near in vain begins again.
REMEMBERED_FRAMES = 5


@functools.cache
def turns(limit_deg: float, step_deg: float) -> FloatArray:
    """Rotations on a cubic lattice of rotation vectors, the smallest first. Shapes: returns (m, 4, 4)."""
    count = int(np.floor(limit_deg / step_deg + 1e-9))
    steps = step_deg * np.arange(-count, count + 1)
    vectors = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.linalg.norm(vectors, axis=1)
    vectors = vectors[np.argsort(size, kind="stable")][: int(np.count_nonzero(size <= limit_deg + 1e-9))]
    return twist.exp(np.hstack([np.deg2rad(vectors), np.zeros_like(vectors)]))


def candidates(T_last: FloatArray, T_predicted: FloatArray, limit_deg: float, step_deg: float) -> FloatArray:
    """Poses to begin with: the prediction, the last pose, and the last pose turned, at the place of either.

    Shapes: returns (m, 4, 4).
    """
    turned = T_last @ turns(limit_deg, step_deg)
    carried = turned.copy()
    carried[:, :3, 3] = T_predicted[:3, 3]
    return np.concatenate([T_predicted[None], turned, carried])


def screen(surface: MapSurface, points: FloatArray, poses: FloatArray, cap: float, keep: int) -> FloatArray:
    """The poses under which the points lie nearest to the map. Shapes: poses (m, 4, 4), returns (keep, 4, 4)."""
    return best_poses(surface, points, poses, cap, (SHORTLIST_PER_KEPT * keep, keep))


def best_poses(
    surface: MapSurface, points: FloatArray, poses: FloatArray, cap: float, keep: tuple[int, int]
) -> FloatArray:
    """The same, the best first, with how many are kept by few points, and of those by more."""
    for judges, kept in zip((FIRST_JUDGING_POINTS, JUDGING_POINTS), keep, strict=True):
        rows = np.linspace(0, len(points) - 1, min(judges, len(points))).round().astype(np.int64)
        moved = np.matmul(points[rows], poses[:, :3, :3].transpose(0, 2, 1)) + poses[:, None, :3, 3]
        away = surface.distances(moved.reshape(-1, 3), cap).reshape(len(poses), -1)
        poses = poses[np.argsort(away.mean(axis=1), kind="stable")[:kept]]
    return poses


class Pace:
    """What has told the last motions best: that they stay as they are, or that they go on to change as they do."""

    def __init__(self) -> None:
        self._change = np.zeros(6)
        self._expected: tuple[FloatArray, ...] = ()
        # How far the points of the last frames were from where either put them, root mean square.
        self._off: deque[tuple[float, ...]] = deque(maxlen=REMEMBERED_FRAMES)

    @property
    def steps(self) -> int:
        """Frames that are remembered."""
        return len(self._off)

    @property
    def off(self) -> float:
        """How far off the better of the two was at most; infinite where nothing is known."""
        return min(map(max, zip(*self._off, strict=True)), default=np.inf)

    def expect(self, T_last: FloatArray, motion: FloatArray, ratio: float) -> tuple[FloatArray, FloatArray]:
        """Pose of the next frame, so many times the last motion on, and the motion during it."""
        motions = motion, single_pose.exp(_twist(motion) + self._change)
        self._expected = tuple(predict(T_last, each, ratio) for each in motions)
        velocity, acceleration = map(max, zip(*self._off, strict=True)) if self._off else (0.0, 0.0)
        best = int(acceleration < velocity)
        return self._expected[best], motions[best]

    def leave(self, T: FloatArray) -> None:
        """Leave it to others where the next frame is expected, (4, 4)."""
        self._expected = T, T

    def learn(self, spread: Spread, T: FloatArray, before: FloatArray, motion: FloatArray) -> None:
        """Remember how far off either was of a pose, and how the motion has changed."""
        self._off.append(tuple(spread.motion(expected, T) for expected in self._expected))
        self._change = _twist(motion) - _twist(before)


def predict(T_last: FloatArray, motion: FloatArray, ratio: float) -> FloatArray:
    """Constant velocity, along one screw."""
    step = motion if ratio == 1.0 else single_pose.exp(ratio * _twist(motion))
    return T_last @ step


def _twist(motion: FloatArray) -> FloatArray:
    return single_pose.log(motion[:3, :3], motion[:3, 3])
