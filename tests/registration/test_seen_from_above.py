"""A part that is seen from above only: its rims hold three motions, as well as the covariance says and no better."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.synth import parts
from tests.strategies import FloatArray

TRIALS = 16


@cache
def prepared(name: str) -> dqreg.Target:
    return dqreg.prepare_target(getattr(parts, name)()[:2])


def from_above(name: str, trial: int, prior_sigma: float | None, verdict: bool) -> tuple[FloatArray, FloatArray]:
    """Errors in rz, tx and ty, in standard deviations, and the errors in sizes."""
    vertices, faces = getattr(parts, name)()[:2]
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    rng = np.random.default_rng(trial)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    areas = np.where(cross[:, 2] > 0.99 * np.linalg.norm(cross, axis=1), cross[:, 2], 0.0)
    rows, u = rng.choice(len(areas), 6_000, p=areas / areas.sum()), rng.random((2, 6_000, 1))
    u = np.where(u.sum(axis=0) > 1.0, 1.0 - u, u)
    truth = a[rows] + u[0] * (b - a)[rows] + u[1] * (c - a)[rows]
    scan = truth + 1e-3 * size * rng.normal(size=truth.shape)
    centre = np.eye(4)
    centre[:3, 3] = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    sigma = np.r_[[prior_sigma or 3e-3] * 3, [(prior_sigma or 3e-3) * size] * 3]
    start = centre @ pose.exp(sigma * rng.normal(size=6)) @ pose.inverse(centre)
    prior = (start, np.diag(sigma**2)) if prior_sigma else None
    result = dqreg.register(scan, prepared(name), start, search="never", effort="fast", verdict=verdict, prior=prior)
    error = np.asarray(pose.log(pose.inverse(centre) @ pose.inverse(result.T_target_source) @ centre))[2:5]
    if prior_sigma:
        beyond = np.linalg.eigvalsh((result.information - np.diag(sigma**-2.0)) * np.outer(sigma, sigma))
        assert beyond[0] > -1e-6 * beyond[-1]
    return error / np.sqrt(np.diag(result.covariance))[2:5], error / [1.0, size, size]


@pytest.mark.parametrize(
    ("name", "verdict", "prior_sigma"),
    [
        # Judged they come to the same, in five times the time: the search asks what the rims leave open.
        ("plate", False, None),
        pytest.param("plate", True, None, marks=pytest.mark.soak),
        ("plate", True, 5e-3),
        pytest.param("plate", True, 5e-4, marks=pytest.mark.soak),
        ("bracket", False, None),
        pytest.param("bracket", False, 5e-3, marks=pytest.mark.soak),
        ("bracket", False, 5e-4),
    ],
)
def test_the_covariance_says_how_far_off_the_pose_is(name: str, verdict: bool, prior_sigma: float | None) -> None:
    found = [from_above(name, trial, prior_sigma, verdict) for trial in range(TRIALS)]
    z = np.sqrt(np.mean([z**2 for z, _ in found], axis=0))
    # Where each point over an edge counted as one, they came to 2 to 6.
    assert (z < 2.0).all(), z
    assert (z > 0.4).all(), z
    errors = np.sqrt(np.mean([error**2 for _, error in found], axis=0))
    assert (errors < [3e-3, 8e-4, 8e-4]).all(), errors
