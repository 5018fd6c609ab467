"""Edges with a known error, without any scan: what the graph is tested on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.trust.records import Reason, Verdict


def registration(T: FloatArray, covariance: FloatArray, centre: FloatArray, level: str = "accepted") -> Registration:
    """A result that measures a pose."""
    return Registration(
        T_target_source=T,
        verdict=Verdict(level, (Reason("made by hand", "accepted" if level == "accepted" else "deviating_patches"),)),
        status="converged",
        covariance=covariance,
        observability=(),
        alternatives=(),
        history=(),
        rms=0.01,
        inlier_fraction=0.8,
        timings={"total": 1.0},
        settings={"centre": centre.tolist(), "diagonal": 2.0},
    )


def world(count: int, seed: int) -> FloatArray:
    """Poses of so many scans on a ring, (n, 4, 4); the first is the identity."""
    rng = np.random.default_rng(seed)
    step = pose.exp(np.r_[0.0, 0.0, 2.0 * np.pi / count, 0.0, 0.0, 0.0])
    T = [np.eye(4)]
    for _ in range(count - 1):
        T.append(T[-1] @ step @ pose.exp(np.r_[0.02 * rng.normal(size=3), 0.1 * rng.normal(size=3)]))
    return np.stack(T)


def edges_of(
    T: FloatArray,
    pairs: Iterable[tuple[int, int]],
    sigma: float,
    seed: int,
    wrong: frozenset[tuple[int, int]] = frozenset(),
) -> list[Edge]:
    """Edges whose errors are drawn from their covariances; wrong ones measure a random pose."""
    rng = np.random.default_rng(seed)
    found = []
    for i, j in pairs:
        centre = rng.normal(size=3)
        A = rng.normal(size=(6, 6))
        covariance = sigma**2 * (0.3 * np.eye(6) + 0.05 * A @ A.T)
        error = pose.about(pose.exp(np.linalg.cholesky(covariance) @ rng.normal(size=6)), centre)
        # The twist leads from the measured pose to the true one.
        measured = pose.inverse(error) @ pose.inverse(T[i]) @ T[j]
        other = pose.random(rng, reach=1.0)
        found.append(Edge(i, j, registration(other if (i, j) in wrong else measured, covariance, centre)))
    return found
