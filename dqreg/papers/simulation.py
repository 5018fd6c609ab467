"""One simulated set-up of points and directions, solved thousands of times under different weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.papers.trials import (
    choose_directions,
    choose_points,
    paper_pose,
    position_errors,
    rms_estimate,
    rotation_errors,
    tilt,
)
from dqreg.report.table import Estimate
from dqreg.rigid import pose
from dqreg.solvers import solve_many
from dqreg.solvers.cramer_rao import covariance_of_weights, cramer_rao, rms_of
from dqreg.synth.parts.blocks import FEEDER_CENTRE


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of one way to weigh."""

    turn_deg: Estimate  # Root mean square rotation error in degrees
    shift: Estimate  # Root mean square error of the place of the part's centre, a length


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """Sets of model points and directions with noise drawn once, so that all weights meet the same measurements."""

    points: FloatArray  # (choices, n, 3): Model points
    directions: FloatArray  # (choices, m, 3): Unit model directions; m may be 0
    point_noise: FloatArray  # (choices, trials, n, 3): Standard normal numbers
    direction_noise: FloatArray  # (choices, trials, m, 3): Likewise

    @staticmethod
    def draw(rng: np.random.Generator, counts: tuple[int, int], choices: int, trials: int) -> SetUp:
        """Draw sets of vertices of the stand-in and of directions."""
        n, m = counts
        return SetUp(
            choose_points(rng, choices, n),
            choose_directions(rng, choices, m),
            rng.normal(size=(choices, trials, n, 3)),
            rng.normal(size=(choices, trials, m, 3)),
        )

    def first_directions(self, count: int) -> SetUp:
        """Keep the first directions of every set."""
        return SetUp(self.points, self.directions[:, :count], self.point_noise, self.direction_noise[:, :, :count])

    def simulate(self, sigmas: tuple[float, float], weights: tuple[float, float]) -> Accuracy:
        """Measure with noise, solve with weights, and compare with the truth."""
        choices, trials, n, _ = self.point_noise.shape
        m, T_truth = self.directions.shape[1], paper_pose()
        R, t = T_truth[:3, :3], T_truth[:3, 3]
        measured = (self.points @ R.T + t)[:, np.newaxis] + sigmas[0] * self.point_noise
        seen = tilt((self.directions @ R.T)[:, np.newaxis], sigmas[1], self.direction_noise)
        fits = solve_many(
            np.repeat(self.points, trials, axis=0),
            measured.reshape(-1, n, 3),
            np.repeat(self.directions, trials, axis=0) if m else None,
            seen.reshape(-1, m, 3) if m else None,
            np.full((choices * trials, n), weights[0]),
            np.full((choices * trials, m), weights[1]) if m else None,
        )
        T = fits.T_target_source.reshape(choices, trials, 4, 4)
        turn = rms_estimate(np.rad2deg(rotation_errors(T, T_truth)))
        return Accuracy(turn, rms_estimate(position_errors(T, T_truth, FEEDER_CENTRE)))

    def predict(self, sigmas: tuple[float, float], weights: tuple[float, float] | None = None) -> tuple[float, float]:
        """Root mean square errors by theory: of given weights, or the least possible ones."""
        T_truth = paper_pose()
        moved = np.asarray(pose.apply(T_truth, self.points.reshape(-1, 3))).reshape(self.points.shape)
        seen, centre = self.directions @ T_truth[:3, :3].T, pose.apply(T_truth, FEEDER_CENTRE[np.newaxis])[0]
        try:
            if weights is None:
                covariance = cramer_rao(moved, seen, centre, *sigmas)
            else:
                covariance = covariance_of_weights(moved, seen, centre, sigmas, weights)
        except (np.linalg.LinAlgError, DegenerateGeometryError):
            return np.nan, np.nan
        turn, shift = rms_of(covariance)
        return float(np.rad2deg(turn)), shift
