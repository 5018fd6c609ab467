from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface, PointCloud, sample_mesh
from dqreg.prepared import prepare_target
from dqreg.register import register
from dqreg.rigid import pose
from dqreg.solvers import solve
from dqreg.solvers.scale import SurfaceMatches, robust_weights, scale_on_planes, solve_scale
from dqreg.solvers.similarity import similarity
from dqreg.synth.parts import bracket
from tests.strategies import poses

FloatArray = NDArray[np.float64]
SCALES = st.floats(np.log(0.5), np.log(2000.0)).map(lambda x: float(np.exp(x)))
P = np.random.default_rng(0).normal(size=(40, 3))
BETA = np.random.default_rng(1).uniform(0.1, 2.0, size=40)


@settings(deadline=None, max_examples=60)
@given(SCALES, poses())
def test_exact_matches_give_their_scale_and_pose(scale: float, T: FloatArray) -> None:
    q = pose.apply(T, scale * P)
    found = similarity(P, q, BETA)
    size = np.abs(q).max() + scale
    assert found.scale == pytest.approx(scale, rel=1e-12 * (1.0 + size / scale))
    np.testing.assert_allclose(pose.apply(found.T_target_source, found.scale * P), q, atol=1e-11 * size)


@settings(deadline=None, max_examples=40)
@given(SCALES, st.integers(0, 2**32 - 1))
def test_exchanging_the_sides_inverts_the_scale_even_with_noise(scale: float, seed: int) -> None:
    # Horn's reason for the symmetric form; the least-squares form misses this by the share of noise.
    q = scale * (P + np.random.default_rng(seed).normal(scale=0.3, size=P.shape))
    there, back = similarity(P, q, BETA), similarity(q, P, BETA)
    assert there.scale * back.scale == pytest.approx(1.0, rel=1e-13)


def test_the_pose_is_that_of_solve_for_the_scaled_source() -> None:
    q = 3.0 * P + np.random.default_rng(2).normal(scale=0.1, size=P.shape)
    found = similarity(P, q, BETA)
    np.testing.assert_array_equal(found.T_target_source, solve(found.scale * P, q, point_weights=BETA).T_target_source)


def test_a_side_in_one_place_has_no_scale() -> None:
    with pytest.raises(DegenerateGeometryError, match="one place"):
        similarity(P, np.ones_like(P))


def planes(rng: np.random.Generator, n: int = 300) -> tuple[FloatArray, FloatArray]:
    normals = rng.normal(size=(n, 3))
    return rng.normal(size=(n, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("factor", [0.97, 1.0, 1.001, 1.04])
def test_one_step_undoes_a_small_scale_and_motion_to_first_order(factor: float) -> None:
    rng = np.random.default_rng(3)
    q, n = planes(rng)
    small = 1e-3 * rng.normal(size=3)
    moved = q / factor + small
    found, _ = scale_on_planes(SurfaceMatches(moved, q, n, rng.uniform(0.5, 1.0, size=len(q))))
    assert found == pytest.approx(factor, abs=0.6 * (factor - 1.0) ** 2 + 1e-12)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e5])
def test_the_step_and_its_sigma_do_not_depend_on_the_unit_and_sigma_is_what_repeats_scatter(size: float) -> None:
    factors, sigmas = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        q, n = planes(rng)
        noisy = q + 1e-3 * rng.normal(size=(len(q), 1)) * n
        factor, sigma = scale_on_planes(SurfaceMatches(size * noisy, size * q, n, np.ones(len(q))))
        factors.append(np.log(factor))
        sigmas.append(sigma)
    # 60 repeats know a standard deviation to 9 %.
    assert np.std(factors) == pytest.approx(np.mean(sigmas), rel=0.3)


def test_what_leaves_the_scale_free_is_refused() -> None:
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.normal(size=(100, 2)), np.zeros(100)])
    up = np.tile([0.0, 0, 1], (100, 1))
    with pytest.raises(DegenerateGeometryError, match="scale free"):
        scale_on_planes(SurfaceMatches(flat, flat, up, np.ones(100)))
    with pytest.raises(DegenerateGeometryError, match="too few"):
        scale_on_planes(SurfaceMatches(flat[:5], flat[:5], up[:5], np.ones(5)))
    with pytest.raises(DegenerateGeometryError, match="scale free"):
        solve_scale(lambda s, T: SurfaceMatches(s * flat, s * flat, up, np.ones(100)), [1.0, 2.0])


@pytest.mark.parametrize("starts", [[], [0.0], [-1.0], [np.inf], ["1"]])
def test_starts_that_are_no_scales_are_refused(starts: list[float]) -> None:
    with pytest.raises(InputError, match="starts must be scales above 0"):
        solve_scale(lambda s, T: SurfaceMatches(P, P, P, BETA), starts)


@pytest.mark.parametrize("scale", [0.5, 2000.0])
def test_scale_and_pose_in_turns_find_a_scan_of_unknown_unit(scale: float) -> None:
    # A scan of all sides with noise of 2e-4 S, 3 degrees off, its numbers divided by the scale; starts 4 % to either
    # side of the truth. The bound is five times the sigma that comes with the answer.
    part = Mesh(*bracket())
    rng = np.random.default_rng(5)
    points = sample_mesh(part, 3000, rng).points + rng.normal(scale=2e-4 * part.diagonal, size=(3000, 3))
    raw, noise = points / scale, 2e-4 * part.diagonal
    target, surface = prepare_target(part), MeshSurface(part)

    def align(s: float, T: FloatArray | None) -> SurfaceMatches:
        result = register(PointCloud(s * raw), target, np.eye(4) if T is None else T, effort="fast")
        moved = result.apply(s * raw)
        found = surface.closest(moved)
        weights = robust_weights(found.distances, noise)
        misfit = float(np.median(found.distances)) / (noise * s / scale)
        return SurfaceMatches(moved, found.points, found.normals, weights, result.T_target_source, misfit)

    fit = solve_scale(align, [1.04 * scale])
    assert fit.converged
    assert fit.misfit < 2.0
    assert abs(fit.scale / scale - 1.0) <= 5.0 * fit.sigma
    assert fit.sigma < 5e-5
