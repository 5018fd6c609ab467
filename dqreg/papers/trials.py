"""Simulated measurements with a known pose, and the errors of the poses found from them."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.papers.printed import WALKER
from dqreg.report.table import Estimate
from dqreg.rigid import pose, quaternion
from dqreg.synth.parts.blocks import FEEDER_DIAGONAL, feeder_vertices

# Walker section 4: a rotation, then a shift, then noise on every coordinate.
_SIMULATION = WALKER["simulation"]
AXIS, SHIFT = np.array(_SIMULATION["axis"]), np.array(_SIMULATION["shift"])
ANGLE_RAD = float(np.deg2rad(_SIMULATION["angle_deg"]))
SIGMA: float = _SIMULATION["sigma"]

# Chosen points must spread across a line by this share of the part, or their rotation is as good as free.
LEAST_SPREAD = 0.05


def paper_pose() -> FloatArray:
    """Pose of the paper's simulations.

    >>> paper_pose()[:3, 3].tolist()
    [7.0, 8.0, 13.0]
    """
    return pose.from_parts(quaternion.to_matrix(quaternion.from_axis_angle(AXIS, ANGLE_RAD)), SHIFT)


def choose_points(rng: np.random.Generator, choices: int, count: int) -> FloatArray:
    """Sets of distinct vertices of the stand-in that fix a rotation, where there are three or more.

    Shapes: returns (choices, count, 3).

    >>> choose_points(np.random.default_rng(0), 4, 3).shape
    (4, 3, 3)
    """
    vertices = feeder_vertices()
    kept: list[FloatArray] = []
    while len(kept) < choices:
        points = vertices[rng.choice(len(vertices), count, replace=False)]
        across = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1:2] / np.sqrt(count)
        if count < 3 or across[0] >= LEAST_SPREAD * FEEDER_DIAGONAL:
            kept.append(points)
    return np.array(kept)


def choose_directions(rng: np.random.Generator, choices: int, count: int) -> FloatArray:
    """Unit directions drawn evenly over the sphere. Shapes: returns (choices, count, 3)."""
    drawn = rng.normal(size=(choices, count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=-1, keepdims=True))


def tilt(directions: FloatArray, sigma_rad: float, noise: FloatArray) -> FloatArray:
    """Turn unit directions by Gaussian angles, alike in all ways that are across them.

    Shapes: directions (..., 3), noise (..., 3), returns (..., 3).
    """
    across = sigma_rad * (noise - np.sum(noise * directions, axis=-1, keepdims=True) * directions)
    angle = np.linalg.norm(across, axis=-1, keepdims=True)
    return np.asarray(np.cos(angle) * directions + np.sinc(angle / np.pi) * across)


def rotation_errors(T: FloatArray, T_truth: FloatArray) -> FloatArray:
    """Angles between rotations, exact for small ones.

    Shapes: T, T_truth (..., 4, 4).

    >>> float(rotation_errors(np.eye(4), np.diag([1.0, -1, -1, 1])).round(12))
    3.14159265359
    """
    chord = np.linalg.norm(T[..., :3, :3] - T_truth[..., :3, :3], axis=(-2, -1)) / np.sqrt(8.0)
    return np.asarray(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def position_errors(T: FloatArray, T_truth: FloatArray, at: FloatArray) -> FloatArray:
    """Distances between the places where two poses put a point of the part.

    Shapes: T, T_truth (..., 4, 4).

    >>> float(position_errors(np.eye(4), np.eye(4), np.ones(3)))
    0.0
    """
    change = T - T_truth
    return np.asarray(np.linalg.norm(change[..., :3, :3] @ at + change[..., :3, 3], axis=-1))


# Standard errors beyond which a difference is not chance.
SURE_SIGMAS = 4.0


def exceeds(a: Estimate, b: Estimate) -> bool:
    """Whether one simulated number is larger than another beyond chance; false where either is NaN.

    >>> exceeds(Estimate(2.0, 0.1), Estimate(1.0, 0.1)), exceeds(Estimate(1.1, 0.1), Estimate(1.0, 0.1))
    (True, False)
    """
    return bool(a.value - b.value > SURE_SIGMAS * np.hypot(a.error, b.error))


def rms_estimate(errors: FloatArray) -> Estimate:
    """Root mean square with its Monte-Carlo standard error.

    Shapes: errors (choices, trials).

    >>> rms_estimate(np.full((2, 5), 3.0))
    Estimate(value=3.0, error=0.0)
    """
    squares = errors**2
    mean = float(squares.mean())
    error = float(np.sqrt(squares.var(axis=1, ddof=1).mean() / squares.size))
    return Estimate(float(np.sqrt(mean)), error / (2.0 * float(np.sqrt(mean))) if mean > 0.0 else 0.0)
