"""Costs and freedoms for the tests of `PoseCost`, drawn by Hypothesis or by a seed, with the sums written out."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost
from dqreg.solvers.dof_words import WORDS

SUBSETS = [c for k in range(7) for c in itertools.combinations(WORDS, k)]
# Nine choices of turn axes and shifts that are groups of motions for each axis, the shifts alone, and all turns.
GROUPS = [s for s in SUBSETS if Freedom.only(*s).is_group]


def unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@dataclass
class Mixed:
    """Points, planes, lines and directions that a known pose fits up to noise."""

    truth: FloatArray
    p: FloatArray
    q: FloatArray
    axes: FloatArray
    m: FloatArray
    n: FloatArray
    w: FloatArray

    @property
    def parts(self) -> list[PoseCost]:
        return [
            PoseCost.points(self.p[:3], self.q[:3], self.w[:3]),
            PoseCost.planes(self.p[3:16], self.q[3:16], self.axes[3:16], self.w[3:16]),
            PoseCost.lines(self.p[16:], self.q[16:], self.axes[16:], self.w[16:]),
            PoseCost.directions(self.m, self.n, self.w[:4]),
        ]

    @property
    def cost(self) -> PoseCost:
        return sum(self.parts[1:], start=self.parts[0])

    def residuals(self, T: FloatArray) -> FloatArray:
        """All residuals written out, roots of the weights on them."""
        x, a, w = pose.apply(T, self.p) - self.q, self.axes, np.sqrt(self.w)[:, None]
        along = np.sum(x * a, axis=1, keepdims=True)
        return np.concatenate(
            [
                (w * x)[:3].ravel(),
                (w * along)[3:16].ravel(),
                (w * (x - along * a))[16:].ravel(),
                (w[:4] * (pose.rotate(T, self.m) - self.n)).ravel(),
            ]
        )


def mixed(seed: int, angle_rad: float | None = None, noise: float = 0.05, far: float = 0.0) -> Mixed:
    """Twenty-four features; the turn is random, or about a random axis by a given angle."""
    rng = np.random.default_rng(seed)
    p, axes = rng.normal(size=(24, 3)), unit(rng.normal(size=(24, 3)))
    truth = pose.random(rng, reach=3.0)
    if angle_rad is not None:
        truth = pose.exp(np.r_[angle_rad * unit(rng.normal(size=(1, 3)))[0], rng.normal(size=3)])
    q = pose.apply(truth, p)
    # Planes and lines may be named by any of their points.
    q[3:16] += np.cross(axes[3:16], rng.normal(size=(13, 3)))
    q[16:] += axes[16:] * rng.normal(size=(8, 1))
    m = unit(rng.normal(size=(4, 3)))
    n = pose.rotate(truth, m)
    origin = far * np.array([0.5, 4.4, -0.1])
    q, n = q + noise * rng.normal(size=q.shape), n + noise * rng.normal(size=n.shape)
    return Mixed(pose.about(truth, origin), p + origin, q + origin, axes, m, n, rng.uniform(0.5, 2.0, 24))


def frames(seed: int) -> FloatArray:
    return pose.random(np.random.default_rng(seed), reach=2.0)


def freedoms() -> st.SearchStrategy[tuple[str, ...]]:
    return st.sampled_from(SUBSETS)


def numeric_slopes(value: Callable[[FloatArray], float], step: float) -> tuple[FloatArray, FloatArray]:
    """Gradient and Hessian of a function of six numbers at zero by central differences of fourth order."""
    e = step * np.eye(6)
    gradient = np.array([8 * (value(d) - value(-d)) - (value(2 * d) - value(-2 * d)) for d in e]) / (12 * step)
    hessian = np.array([[value(a + b) - value(a - b) - value(b - a) + value(-a - b) for b in e] for a in e]) / (
        4 * step**2
    )
    return gradient, hessian
