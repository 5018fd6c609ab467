"""A pose that other sensors predict (wheels, an IMU), and the pose of a frame with it: both are weighed."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.registration.remarks import EXCLUDED_SIGMAS
from dqreg.rigid import pose, twist
from dqreg.rigid.pose_covariance import inverse_of_known, read_covariance
from dqreg.rigid.single_pose import orthonormal
from dqreg.trust.covariance import TOUCHED
from dqreg.trust.records import Direction, Reason

# One sigma to three: where a prediction is taken to hold.
COVERED_SIGMAS = 3.0
# Smallest eigenvalue of an information of unit diagonal that is no rounding.
MIN_HELD_INFORMATION = 1e-12


@dataclasses.dataclass(frozen=True)
class Prediction:
    """Where a frame is expected."""

    T_map_frame: FloatArray  # (4, 4)
    information: FloatArray | None = None  # (6, 6): of a left increment about the sensor; None weighs nothing
    doubts: tuple[Reason, ...] = ()  # What speaks against it
    # (4, 4): Of a frame that was sought: where it was about to be placed. Its fit alone tells where it is.
    T_before: FloatArray | None = None

    @staticmethod
    def of(prediction: Any, covariance: Any) -> Prediction | None:
        """What a caller gave, checked."""
        if prediction is None:
            if covariance is not None:
                raise InputError("prediction_covariance needs a prediction: the expected pose T_map_frame")
            return None
        T = as_pose(prediction, "prediction")
        if covariance is None:
            return Prediction(T)
        C = read_covariance(covariance, "prediction_covariance")
        return Prediction(T, inverse_of_known(C, np.isfinite(np.diag(C))))

    @property
    def spread(self) -> float:
        """How far off the place may be; infinite where no covariance was given, or one that leaves it unknown."""
        known = np.zeros(6, dtype=bool) if self.information is None else np.diag(self.information) > 0.0
        if self.information is None or not known[3:].all():
            return np.inf
        place = inverse_of_known(self.information, known)[3:, 3:]
        return COVERED_SIGMAS * float(np.sqrt(np.linalg.eigvalsh(place)[-1]))

    def holds(self, limit: float) -> bool:
        """Whether it tells the place to within a limit, by one sigma."""
        return self.spread <= COVERED_SIGMAS * limit

    def fused(self, T: FloatArray, information: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pose and covariance of a frame with the prediction.

        ``information`` is that of the pose found, (6, 6), of a left increment about the sensor; 0 on free motions.
        """
        assert self.information is not None
        # About the sensor's place in the pose found, as its own information is.
        centre = pose.from_parts(np.eye(3), T[:3, 3])
        carried = pose.adjoint(pose.from_parts(np.eye(3), T[:3, 3] - self.T_map_frame[:3, 3]))
        prior = carried.T @ self.information @ carried
        off = twist.log(orthonormal(pose.inverse(centre) @ self.T_map_frame @ pose.inverse(T) @ centre))
        total = information + prior
        scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
        covariance, is_free = _inverse(total / scale / scale[:, None], bool((np.diag(self.information) > 0.0).all()))
        covariance = covariance / scale / scale[:, None]
        step = covariance @ prior @ off
        covariance = 0.5 * (covariance + covariance.T)
        covariance[is_free], covariance[:, is_free] = np.nan, np.nan
        return orthonormal(centre @ twist.exp(step) @ pose.inverse(centre) @ T), covariance


def _inverse(total: FloatArray, known: bool) -> tuple[FloatArray, BoolArray]:
    """Inverse of an information of unit diagonal, 0 along what neither frame nor prediction knows, and what that is."""
    if known:
        return np.asarray(np.linalg.inv(total), dtype=np.float64), np.zeros(6, dtype=bool)
    values, vectors = np.linalg.eigh(total)
    held = values > MIN_HELD_INFORMATION
    touched = (np.abs(vectors[:, ~held]) > TOUCHED).any(axis=1)
    return np.asarray((vectors[:, held] / values[held]) @ vectors[:, held].T), touched


def held_directions(
    directions: tuple[Direction, ...], covariance: FloatArray, lever: float, limit: float
) -> tuple[Direction, ...]:
    """Motions that the frame leaves free and a prediction holds to within a limit, with their standard deviation."""
    return tuple(_held(each, covariance, lever, limit) if each.is_free else each for each in directions)


def _held(direction: Direction, covariance: FloatArray, lever: float, limit: float) -> Direction:
    turns = direction.kind == "rotation"
    part = covariance[:3, :3] * lever**2 if turns else covariance[3:, 3:]
    axis = np.array(direction.axis)
    sigma = float(np.sqrt(axis @ part @ axis))
    if not sigma <= limit:
        return direction
    words = f"{direction.words}, held by the prediction alone to {sigma:.3g}"
    return dataclasses.replace(direction, sigma=sigma, words=words)


def held_notes(before: tuple[Direction, ...], after: tuple[Direction, ...]) -> tuple[Reason, ...]:
    """Which motions the frame leaves free and a prediction holds."""
    held = [b for a, b in zip(before, after, strict=True) if a.is_free and not b.is_free]
    return tuple(Reason(direction.words, "held_by_prediction") for direction in held)


def contradiction(
    T: FloatArray, directions: tuple[Direction, ...], prediction: Prediction, near: float
) -> tuple[Reason, ...]:
    """The doubt of a frame whose place a prediction excludes: one of the two is wrong, and neither tells which."""
    off = T[:3, 3] - prediction.T_map_frame[:3, 3]
    for direction in directions:
        if direction.is_free and direction.kind == "translation":
            off = off - np.dot(direction.axis, off) * np.array(direction.axis)
    apart, limit = float(np.linalg.norm(off)), max(EXCLUDED_SIGMAS / COVERED_SIGMAS * prediction.spread, near)
    if not apart > limit:
        return ()
    words = (
        f"the sensor is {apart:.3g} away from where it is predicted, and {limit:.3g} is as far as the prediction may "
        "be wrong: the frame slipped, or what predicts the motion (wheels) did"
    )
    return (Reason(words, "contradicting_prediction"),)
