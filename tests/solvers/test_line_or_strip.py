"""A line is told from a strip by the rounding of its coordinates, whatever its partner's noise."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose
from dqreg.solvers import PoseCost, closed_form, horn, moments_of, solve, solve_many, solve_rotation, svd
from dqreg.solvers.rounding import SAME_POINT, rounding_of
from tests.solvers.exact_oracle import EPS, random_rotation


def in_two(p, q, w):
    k = len(p) // 2
    return (PoseCost.points(p[:k], q[:k], w[:k]) + PoseCost.points(p[k:], q[k:], w[k:])).minimise()


def many(p, q, w):
    found = solve_many(p[None], q[None], point_weights=w[None])
    if found.degenerate[0]:
        raise DegenerateGeometryError("one of many")
    return found


WAYS = {
    "solve": lambda p, q, w: solve(p, q, point_weights=w),
    "solve_many": many,
    "svd": lambda p, q, w: svd(p, q, point_weights=w),
    "horn": lambda p, q, w: horn(p, q, point_weights=w),
    "a cost": lambda p, q, w: PoseCost.points(p, q, w).minimise(),
    "costs of parts": in_two,
    "a cost brought home": lambda p, q, w: PoseCost.points(p, q, w).recentred(p.mean(0), q.mean(0)).minimise(),
}
powers = st.floats(-6.0, 6.0)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    unit=powers,
    far=st.floats(-2.0, 7.0),
    noise=st.floats(-8.0, -0.5),
    count=st.integers(3, 20),
    on_source=st.booleans(),
    weighed=st.booleans(),
)
def test_a_line_is_refused_beside_a_noisy_copy(seed, unit, far, noise, count, on_source, weighed):
    rng = np.random.default_rng(seed)
    size = 10.0**unit
    p = size * (np.outer(rng.uniform(-0.5, 0.5, count), rng.normal(size=3)) + 10.0**far * rng.normal(size=3))
    q = pose.apply(pose.random(rng, reach=size), p) + size * 10.0**noise * rng.normal(size=p.shape)
    w = 10.0 ** rng.uniform(-2, 2, count) if weighed else np.ones(count)
    for way in WAYS.values():
        with pytest.raises(DegenerateGeometryError):
            way(*((q, p) if on_source else (p, q)), w)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    unit=powers,
    far=st.floats(-1.0, 6.0),
    width=st.floats(-8.0, -2.0),
    on_source=st.booleans(),
)
def test_a_triangle_wider_than_its_rounding_is_turned_right(seed, unit, far, width, on_source):
    rng = np.random.default_rng(seed)
    w, size = 10.0**width, 10.0**unit
    grain = SAME_POINT * (1.0 + 10.0**far)
    if not w > 4.0 * grain:
        return
    p = np.array([[-0.5, 0, 0], [0.5, 0, 0], [0.1, w, 0]]) @ random_rotation(rng).T
    R = random_rotation(rng)
    q = (p + 0.1 * w * rng.uniform(-1, 1, p.shape)) @ R.T
    centres = 10.0**far * rng.normal(size=(2, 1, 3))
    centres /= np.linalg.norm(centres, axis=-1, keepdims=True) / 10.0**far
    p, q = size * (p + centres[0]), size * (q + centres[1])
    if on_source:
        p, q, R = q, p, R.T
    for name in ("solve", "solve_many", "a cost", "costs of parts", "a cost brought home"):
        T = WAYS[name](p, q, np.ones(3)).T_target_source.reshape(4, 4)
        # The noise is a tenth of the width, the grain a quarter at most.
        assert np.linalg.norm(T[:3, :3] - R) < 1.0


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    width=st.floats(-14.0, -1.0),
    far=st.floats(-1.0, 8.0),
    noise=st.floats(-12.0, 0.0),
    directed=st.booleans(),
)
def test_solve_and_solve_many_agree_on_what_is_degenerate(seed, width, far, noise, directed):
    rng = np.random.default_rng(seed)
    p = rng.uniform(-0.5, 0.5, (5, 3)) * [1.0, 10.0**width, 10.0**width] @ random_rotation(rng).T
    p += 10.0**far * rng.normal(size=3)
    q = p + 10.0**noise * rng.normal(size=p.shape)
    m = rng.normal(size=(1, 3)) if directed else None
    fits = solve_many(p[None], q[None], *((m[None], m[None]) if directed else ()))
    with mock.patch.object(closed_form, "require_determined", wraps=closed_form.require_determined) as asked:
        try:
            fit = solve(p, q, m, m)
        except DegenerateGeometryError:
            fit = None
    if asked.called:
        _, gap, _, floor, _ = asked.call_args.args
        # At the limit itself the last bits of the sums decide, and those of a stack are added in another order.
        assume(not 0.5 * floor < gap < 2.0 * floor)
    assert fits.degenerate[0] == (fit is None)
    if fit is not None:
        # At the limit of what is accepted rounding may roll a strip by 1/16 rad, at twice that by half, in either.
        np.testing.assert_allclose(fits.T_target_source[0, :3, :3], fit.T_target_source[:3, :3], atol=1.0 / 16.0)


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-2])
def test_parallel_directions_are_refused_beside_noisy_ones(noise):
    rng = np.random.default_rng(1)
    for _ in range(20):
        m = np.outer(rng.uniform(0.5, 2.0, 3), random_rotation(rng)[0])
        n = m + noise * rng.normal(size=m.shape)
        for pair in ((m, n), (n, m)):
            with pytest.raises(DegenerateGeometryError):
                solve_rotation(*pair)
            at_a_point = [side[None] for side in (np.ones((1, 3)), np.ones((1, 3)), *pair)]
            assert solve_many(*at_a_point).degenerate.all()


@pytest.mark.parametrize("way", ["solve", "solve_many", "svd"])
def test_a_far_mirror_image_is_refused(way):
    # Every turn fits alike but for the rounding, 1e-10 of the size: more than that of a difference of eigenvalues.
    corners = np.vstack([np.eye(3), -np.eye(3)])
    rng = np.random.default_rng(2)
    for _ in range(20):
        p, q = corners + 1e6 * rng.normal(size=3), -corners + 1e6 * rng.normal(size=3)
        with pytest.raises(DegenerateGeometryError):
            WAYS[way](p, q, np.ones(6))


def test_a_line_leaves_a_given_pose_its_turn():
    rng = np.random.default_rng(3)
    p = np.outer([0.0, 0.4, 1.0], [1.0, 0, 0]) @ random_rotation(rng).T + 1e5 * rng.normal(size=3)
    q = p + 0.01 * rng.normal(size=p.shape)
    found = PoseCost.points(p, q).minimise(near=np.eye(4))
    assert len(found.free) == 1
    assert "rotation" in found.free[0]


def test_rounding_moves_the_products_by_no_more_than_is_said():
    rng = np.random.default_rng(4)
    for _ in range(100):
        w, far = rng.uniform(0.1, 10, 6), 10.0 ** rng.uniform(0, 6, 2)
        exact = [rng.normal(size=(6, 3)) * 10.0 ** rng.uniform(-6, 0, 3) + far[k] for k in (0, 1)]
        held = [side * (1.0 + EPS / 2 * rng.uniform(-1, 1, side.shape)) for side in exact]
        one, two = (moments_of(*pair, point_weights=w) for pair in (exact, held))
        grains = [SAME_POINT * np.sqrt(w @ (side**2).sum(axis=1)) for side in exact]
        sizes = np.sqrt(one.spread_source), np.sqrt(one.spread_target)
        assert np.linalg.norm(one.point_cross - two.point_cross) <= rounding_of(grains, sizes)
