"""Matched problems for the tests of the solvers, drawn by Hypothesis, and the pose that made them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dqreg._arrays import FloatArray
from tests.strategies import floats, poses, rotations

fast = settings(deadline=None, max_examples=40)
# Four points that no drawing can make degenerate; drawn ones come on top.
TETRAHEDRON = np.array([[2.0, 0, 0], [0, 3.0, 0], [0, 0, 4.0], [-1, -1, -2.0]])


@dataclass
class Problem:
    T: FloatArray
    points: tuple[FloatArray, FloatArray]
    directions: tuple[FloatArray, FloatArray] | tuple[None, None] = (None, None)
    beta: FloatArray | None = None
    alpha: FloatArray | None = None

    @property
    def args(self) -> tuple[FloatArray | None, ...]:
        return (*self.points, *self.directions, self.beta, self.alpha)

    @property
    def back(self) -> tuple[FloatArray | None, ...]:
        return (*self.points[::-1], *self.directions[::-1], self.beta, self.alpha)


@cache
def blocks(rows: int, bound: float) -> st.SearchStrategy[FloatArray]:
    return arrays(np.float64, (rows, 3), elements=floats(-bound, bound))


@cache
def _numbers(count: int, low: float, high: float) -> st.SearchStrategy[FloatArray]:
    return arrays(np.float64, count, elements=floats(low, high))


@cache
def _counts(low: int, high: int) -> st.SearchStrategy[int]:
    return st.integers(low, high)


@st.composite
def problems(
    draw: st.DrawFn, *, noise: float = 0.2, directions: bool = True, weights: bool = True, far: bool = True
) -> Problem:
    """Four fixed points and up to six drawn ones, up to four directions, noise on each target coordinate."""
    T = draw(poses())
    if not far:
        T[:3, :3], T[:3, 3] = draw(rotations()), draw(_numbers(3, -5.0, 5.0))
    p = np.vstack([TETRAHEDRON, draw(blocks(draw(_counts(0, 6)), 5.0))])
    q = p @ T[:3, :3].T + T[:3, 3] + draw(blocks(len(p), noise))
    problem = Problem(T, (p, q))
    m = draw(_counts(1, 4)) if directions else 0
    if m:
        a = np.vstack([TETRAHEDRON[:1], np.add(draw(blocks(m, 1.0)), [0.0, 0.0, 3.0])])
        b = a @ T[:3, :3].T + draw(blocks(len(a), noise))
        unit = tuple(side / np.linalg.norm(side, axis=1, keepdims=True) for side in (a, b))
        problem.directions = (unit[0], unit[1])
    if weights:
        problem.beta = draw(_numbers(len(p), 0.5, 4.0))
        problem.alpha = draw(_numbers(m + 1, 0.5, 4.0)) if m else None
    return problem


def euclidean_cost(T: FloatArray, problem: Problem) -> float:
    """The cost by its definition."""
    p, q, m, n, beta, alpha = problem.args
    R, t = T[:3, :3], T[:3, 3]
    # About the first match, as R p + t rounds at the size of a far translation.
    residual = (p - p[0]) @ R.T - (q - q[0]) + ((R - np.eye(3)) @ p[0] + t - (q[0] - p[0]))
    total = ((1.0 if beta is None else beta) * (residual**2).sum(axis=1)).sum()
    if m is not None:
        total += ((1.0 if alpha is None else alpha) * ((m @ R.T - n) ** 2).sum(axis=1)).sum()
    return float(total)


def assert_same_pose(T: FloatArray, other: FloatArray, tolerance: float = 1e-12) -> None:
    """Equal rotations, and translations equal to the rounding of their size."""
    np.testing.assert_allclose(T[:3, :3], other[:3, :3], rtol=0, atol=tolerance)
    reach = 10.0 + np.abs(other[:3, 3]).max()
    np.testing.assert_allclose(T[:3, 3], other[:3, 3], rtol=0, atol=tolerance * reach)
