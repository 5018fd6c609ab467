"""Motion between frames by another sensor: wheels (poses) or a gyroscope (angular velocities), as a prediction.

The prediction never replaces the frame: both are weighed by their covariances.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.registration.result.result import Registration
from dqreg.rigid import Trajectory, pose, quaternion

# A topic that is silent for so many of its usual steps says nothing of the motion meanwhile.
MAX_SILENT_STEPS = 10.0
# Wheels: one sigma as a fraction of the motion,
SLIP_SHARE = 0.05
# and at least so many radians and voxels.
MIN_WHEEL_SIGMA_RAD, MIN_WHEEL_SIGMA_VOXELS = np.deg2rad(0.3), 0.1
# Gyroscope: error of its scale, and bias (of a MEMS one in the warm).
GYRO_SCALE_SHARE, GYRO_BIAS_RAD_PER_SECOND = 0.02, np.deg2rad(0.5)
# One sigma at least.
MIN_GYRO_SIGMA_RAD = np.deg2rad(0.1)
# One sigma of constant velocity, over its step and over the reach of closest points: beyond the latter nothing is held.
VELOCITY_SIGMA_STEPS, VELOCITY_SIGMA_REACHES = 2.0, 3.0


@dataclasses.dataclass(frozen=True, eq=False)
class Wheels:
    """Poses that drift."""

    path: Trajectory
    rates: FloatArray  # (n, 6): Variances of the velocities as the driver states them, rotation first; 0 if it does not

    @property
    def times(self) -> FloatArray:
        """Of the poses."""
        return self.path.times

    def between(self, start: float, end: float) -> FloatArray:
        """Pose of the body at the end in its frame at the start, (4, 4), along the screws between the poses."""
        first, last = self.path.at([start, end])
        return np.asarray(pose.inverse(first) @ last)

    def covariance(self, motion: FloatArray, seconds: float, lengths: dict[str, Any]) -> FloatArray:
        """Of a right increment at the end of a motion, (6, 6), rotation first.

        Slip of a fraction of the motion, or what the driver states if that is more.
        """
        turn = MIN_WHEEL_SIGMA_RAD + SLIP_SHARE * float(pose.angle_between(np.eye(4), motion))
        step = MIN_WHEEL_SIGMA_VOXELS * lengths["voxel_size"] + SLIP_SHARE * float(np.linalg.norm(motion[:3, 3]))
        own = np.repeat([turn**2, step**2], 3)
        return np.diag(np.maximum(own, np.median(self.rates, axis=0) * seconds**2))


@dataclasses.dataclass(frozen=True, eq=False)
class Gyroscope:
    """Angular velocities in the sensor's own axes."""

    times: FloatArray  # (n,): Increasing, seconds
    rates: FloatArray  # (n, 3): Radians a second

    def between(self, start: float, end: float) -> FloatArray:
        """Rotation, followed on the unit quaternions from sample to sample by the mean velocity."""
        inside = self.times[(self.times > start) & (self.times < end)]
        knots = np.concatenate([[start], inside, [end]])
        rates = np.column_stack([np.interp(knots, self.times, column) for column in self.rates.T])
        halves = 0.25 * (rates[1:] + rates[:-1]) * np.diff(knots)[:, None]
        steps = quaternion.exp(np.column_stack([np.zeros(len(halves)), halves]))
        q = quaternion.normalize(functools.reduce(quaternion.multiply, steps))
        return pose.from_parts(quaternion.to_matrix(q), np.zeros(3))

    def covariance(self, motion: FloatArray, seconds: float, lengths: dict[str, Any]) -> FloatArray:
        """Scale and bias; that of the translation is constant velocity's and not this sensor's."""
        turn = (
            MIN_GYRO_SIGMA_RAD
            + GYRO_SCALE_SHARE * float(pose.angle_between(np.eye(4), motion))
            + GYRO_BIAS_RAD_PER_SECOND * seconds
        )
        return np.diag(np.repeat([turn**2, (VELOCITY_SIGMA_REACHES * lengths["reach"]) ** 2], 3))


@dataclasses.dataclass(frozen=True, eq=False)
class MotionPrior:
    """Motion of the sensor of the clouds by another one that is fixed to it."""

    source: Wheels | Gyroscope
    T_body_sensor: FloatArray  # (4, 4): From the clouds' frame to that of the source
    words: str  # What is used, for the screen

    def covers(self, start: float, end: float) -> bool:
        """Whether the source spoke all the time between."""
        times = self.source.times
        if not times[0] <= start < end <= times[-1]:
            return False
        near = times[max(np.searchsorted(times, start, "right") - 1, 0) : np.searchsorted(times, end, "left") + 1]
        return bool(np.diff(near).max() <= MAX_SILENT_STEPS * float(np.median(np.diff(times))))

    def usable(self, stamps: FloatArray) -> BoolArray:
        """Which steps between consecutive stamps are covered, (n - 1,)."""
        return np.array([self.covers(*pair) for pair in itertools.pairwise(stamps)], dtype=bool)


class MotionGuide:
    """Predictions for the frames of a run, from the last frame that was trusted."""

    def __init__(self, prior: MotionPrior) -> None:
        self.prior = prior
        self._lengths: dict[str, Any] | None = None
        self._last: tuple[float, FloatArray] | None = None
        self._velocity = np.zeros(3)  # Of the sensor along its own axes

    def options(self, stamp: float | None) -> dict[str, FloatArray]:
        """Prediction and covariance for `register_frame`; nothing where the topic tells nothing."""
        if self._last is None or self._lengths is None or stamp is None or not np.isfinite(stamp):
            return {}
        start, T_last = self._last
        if not self.prior.covers(start, stamp):
            return {}
        seconds, X, source = stamp - start, self.prior.T_body_sensor, self.prior.source
        motion = source.between(start, stamp)
        carry = pose.adjoint(pose.inverse(X))
        covariance = carry @ source.covariance(motion, seconds, self._lengths) @ carry.T
        step = pose.inverse(X) @ motion @ X
        if isinstance(source, Gyroscope):
            # Of the place it knows nothing, with its lever neither: constant velocity, hardly weighed.
            step[:3, 3] = self._velocity * seconds
            covariance[:3, 3:], covariance[3:, :3] = 0.0, 0.0
            sigma = max(
                VELOCITY_SIGMA_REACHES * self._lengths["reach"],
                VELOCITY_SIGMA_STEPS * float(np.linalg.norm(step[:3, 3])),
            )
            covariance[3:, 3:] = sigma**2 * np.eye(3)
        T = T_last @ step
        turned = np.kron(np.eye(2), T[:3, :3])
        covariance = turned @ covariance @ turned.T
        return {"prediction": T, "prediction_covariance": 0.5 * (covariance + covariance.T)}

    def learn(self, result: Registration, T_last: FloatArray, stamp: float | None) -> None:
        """Take over a frame's pose if the odometry trusts it: its last pose is that."""
        if "reach" in result.settings:
            self._lengths = result.settings
        if stamp is None or not np.array_equal(result.T_target_source, T_last):
            return
        if self._last is not None and stamp > self._last[0]:
            step = pose.inverse(self._last[1]) @ T_last
            self._velocity = step[:3, 3] / (stamp - self._last[0])
        self._last = stamp, T_last
