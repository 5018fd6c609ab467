from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.steps.newton_steps import symmetric_axes
from dqreg.rigid import pose
from dqreg.solvers.newton import descend, local_minimum
from dqreg.solvers.quadratic import QuadraticForm, plane_form, point_form
from tests.solvers.free_chart import FreeChart
from tests.solvers.problems import fast


@compiled
def turn(a: FloatArray, v: FloatArray) -> None:
    symmetric_axes(a, v)


def cost(rng: np.random.Generator, count: int, noise: float, free: int) -> tuple[QuadraticForm, np.ndarray]:
    """Planes through moved points, of which the last ``free`` axes have no normal; and the truth."""
    truth = pose.random(rng, reach=2.0)
    p, n = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    n[:, 3 - free :] = 0.0
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    q = pose.apply(truth, p) + noise * rng.normal(size=(count, 3))
    origins = p.mean(axis=0), q.mean(axis=0)
    return QuadraticForm(plane_form(p, q, n, rng.uniform(0.1, 1.0, count), origins), *origins), truth


@fast
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-3, 0.3]), st.sampled_from([1e-6, 0.1, 0.8]))
def test_it_ends_where_the_plain_method_ends(seed: int, noise: float, away: float) -> None:
    rng = np.random.default_rng(seed)
    form, truth = cost(rng, 40, noise, 0)
    start = truth @ pose.exp(away * rng.normal(size=6))
    found = local_minimum(form, start)
    expected = descend(form, FreeChart(start, form.origin_target)).chart.pose
    # Both stop where the gain is rounding of the cost: a pose that is good to the root of it.
    assert form.value(found) <= form.value(expected) + 1e-12 * form.scale
    if away < 0.5:
        np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-13)


@pytest.mark.parametrize("free", [1, 2])
def test_unconstrained_motions_are_left_alone(free: int) -> None:
    rng = np.random.default_rng(free)
    form, truth = cost(rng, 40, 0.0, free)
    start = truth @ pose.exp(1e-3 * rng.normal(size=6))
    found = local_minimum(form, start)
    expected = descend(form, FreeChart(start, form.origin_target)).chart.pose
    np.testing.assert_allclose(found, expected, atol=1e-8)
    # Both costs are zero but for the rounding of the sums that they are the differences of.
    assert form.value(found) <= form.value(expected) + 16.0 * np.finfo(float).eps * form.scale


def test_at_the_minimum_nothing_moves() -> None:
    rng = np.random.default_rng(0)
    p = rng.normal(size=(30, 3))
    form = QuadraticForm(point_form(p, p, np.ones(30), (np.zeros(3), np.zeros(3))), np.zeros(3), np.zeros(3))
    assert np.array_equal(local_minimum(form, np.eye(4)), np.eye(4))


@fast
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.floats(-8.0, 0.0))
def test_axes_are_those_of_lapack(seed: int, n: int, grade: float) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(n, n)) * np.logspace(0.0, grade, n)
    a, axes = rows.T @ rows, np.zeros((n, n))
    found = a.copy()
    turn(found, axes)
    values = np.diag(found)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(a), atol=1e-14 * np.abs(a).max() * n)
    np.testing.assert_allclose(axes.T @ axes, np.eye(n), atol=1e-13)
    np.testing.assert_allclose(axes * values @ axes.T, a, atol=1e-13 * np.abs(a).max())
