"""A motion that no face holds is known as well as the prior says, no better and no worse; nothing else turns it."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by
from dqreg.solvers.quadratic import QuadraticForm, derivatives, plane_form, projected_form
from dqreg.synth import parts
from dqreg.trust.information import information_of
from tests.strategies import FloatArray

VERTICES, FACES = parts.cylinder()
VERTICES = VERTICES - VERTICES.mean(axis=0)
RADIUS, HEIGHT = float(np.hypot(VERTICES[:, 0], VERTICES[:, 1]).max()), float(np.ptp(VERTICES[:, 2]))
SIZE = float(np.linalg.norm(np.ptp(VERTICES, axis=0)))
SHAFT = dqreg.prepare_target(dqreg.Mesh(VERTICES, FACES))
NOISE, POINTS = 1e-3 * SIZE, 3_000


def round_shaft(rng: np.random.Generator) -> FloatArray:
    """Points on the cylinder that the facets approximate, and on its ends."""
    side = rng.random(POINTS) < HEIGHT / (HEIGHT + RADIUS)
    angle = rng.uniform(0.0, 2.0 * np.pi, POINTS)
    r = np.where(side, RADIUS, RADIUS * np.sqrt(rng.random(POINTS)))
    z = np.where(side, rng.uniform(-0.5, 0.5, POINTS), rng.choice([-0.5, 0.5], POINTS)) * HEIGHT
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z]) + NOISE * rng.normal(size=(POINTS, 3))


def registered(
    sigma: float, off: float, *, cloud: bool = False, ahead: float = 0.0
) -> tuple[float, dqreg.Registration]:
    """Error about the axis, and the result where the prior errs so much; the start may be turned ahead of it."""
    rng = np.random.default_rng(7)
    scan, T = round_shaft(rng), pose.exp(np.r_[0.3, 0.2, 0.1, 3.0, 4.0, 5.0])
    scan = pose.apply(pose.inverse(T), scan)
    T_prior = pose.exp(np.r_[0.0, 0.0, off, 0.0, 0.0, 0.0]) @ T
    known = np.r_[[0.01, 0.01, sigma], [0.01 * SIZE] * 3] ** 2
    start = pose.exp(np.r_[0.0, 0.0, ahead, 0.0, 0.0, 0.0]) @ T_prior
    target = round_shaft(rng) if cloud else SHAFT
    result = dqreg.register(scan, target, start, prior=(T_prior, np.diag(known)), search="never", effort="fast")
    beyond = np.linalg.eigvalsh(result.information - np.diag(1.0 / known))
    assert beyond[0] > -1e-6 * beyond[-1]
    return float(pose.log(T @ pose.inverse(result.T_target_source))[2]), result


@pytest.mark.parametrize("cloud", [False, True], ids=["mesh", "cloud"])
@pytest.mark.parametrize("sigma", [1e-3, *(pytest.param(sigma, marks=pytest.mark.soak) for sigma in (1e-2, 0.1)), 1.0])
def test_a_round_shaft_is_known_about_its_axis_as_well_as_the_prior_says(sigma: float, cloud: bool) -> None:
    off = 0.8 * sigma
    error, result = registered(sigma, off, cloud=cloud)
    assert np.isfinite(result.covariance).all()
    # Errors of normals tilt the axis that is free by a thousandth, and the prior is a hundred times as sure of others.
    assert np.sqrt(result.covariance[2, 2]) == pytest.approx(sigma, rel=0.03)
    # Nothing but the prior has its say.
    assert error == pytest.approx(-off, rel=0.02)
    assert not any(motion.is_free for motion in result.observability)
    assert sum("is constrained by the prior only" in motion.words for motion in result.observability) == 1


def test_a_start_elsewhere_comes_to_the_prior() -> None:
    error, _ = registered(0.1, -0.05, ahead=0.4)
    assert error == pytest.approx(0.05, rel=0.02)


def test_a_prior_that_says_nothing_of_the_axis_feigns_nothing() -> None:
    _, result = registered(np.inf, 0.0)
    assert not result.covariance[2, 2] < np.pi**2
    assert result.verdict.level == "suspect"


@pytest.mark.parametrize("patchwise", [False, True])
def test_the_covariance_is_that_of_what_the_shape_holds_and_the_prior_together(patchwise: bool) -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (4_000, 2)), np.zeros(4_000)])
    up, residuals, lever = np.tile([0.0, 0.0, 1.0], (4_000, 1)), 0.01 * rng.normal(size=4_000), 1.5
    # Sure of some mixtures, and unsure of others: no motion of the plane is known alone.
    mixed = rng.normal(size=(6, 6)) * [0.003, 0.01, 0.03, 0.1, 0.3, 1.0]
    prior = np.asarray(np.linalg.inv(mixed @ mixed.T), dtype=np.float64)
    found = information_of(points, up, residuals, np.ones(4_000), lever, np.zeros(3), patchwise=patchwise, prior=prior)
    assert not found.free.any()
    assert found.beforehand.sum() == 3
    assert found.scatter is not None
    rows = np.column_stack([points[:, 1], -points[:, 0], 0.0 * points[:, 0], up])
    expected = np.linalg.inv(rows.T @ rows / found.sigma**2 + prior) * scaling_by(lever) * scaling_by(lever)[:, None]
    size = np.sqrt(np.diag(expected))
    # Variances from 200 patches scatter by a tenth.
    np.testing.assert_allclose(
        found.scatter / np.outer(size, size), expected / np.outer(size, size), atol=0.3 if patchwise else 1e-6
    )


def test_a_projected_cost_is_the_cost_along_what_is_held_and_flat_along_the_rest() -> None:
    rng = np.random.default_rng(4)
    p, normals = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    T = pose.exp(np.r_[0.4, -0.3, 0.2, 1.0, 2.0, 3.0])
    q = pose.apply(T, p) + 0.01 * rng.normal(size=p.shape)
    origins = p[0], q[0]
    form = QuadraticForm(plane_form(p, q, normals, np.ones(40), origins), *origins)
    free = np.linalg.qr(rng.normal(size=(6, 2)))[0]
    found = projected_form(form, T, np.eye(6) - free @ free.T, np.zeros(6))
    assert found.value(T) == pytest.approx(form.value(T))
    about = form.twists_from(np.eye(4))
    (slope, _, squares), (slope_0, _, squares_0) = derivatives(found, T), derivatives(form, T)
    held = np.linalg.qr(free, mode="complete")[0][:, 2:]
    np.testing.assert_allclose(slope @ about @ free, 0.0, atol=1e-9)
    np.testing.assert_allclose(squares @ about @ free, 0.0, atol=1e-9 * np.trace(squares))
    np.testing.assert_allclose(slope @ about @ held, slope_0 @ about @ held, atol=1e-9)
    np.testing.assert_allclose(held.T @ about.T @ squares @ about @ held, held.T @ about.T @ squares_0 @ about @ held)
