"""Narrow data against 50 digits: w times as wide as long, it loses a factor 1/w of the digits, not its square."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError
from dqreg.solvers import PoseCost, moments_of, solve, solve_many, solve_moments
from dqreg.solvers.narrow_data import NARROW_RATIO, is_narrow, long_axes
from tests.solvers.exact_oracle import EPS, angle_between, best_rotation, random_rotation

# The project's promise: within this factor of eps times length over width.
FACTOR = 20.0


def by_solve(points, directions, beta, alpha):
    return solve(*points, *(directions or (None, None)), beta, alpha).T_target_source


def by_solve_many(points, directions, beta, alpha):
    # Among wide problems, whose own poses must not change.
    rng = np.random.default_rng(1)
    rows = [np.stack([rng.normal(size=side.shape), side, rng.normal(size=side.shape)]) for side in points]
    ways = [np.stack([side, side, side]) for side in directions] if directions else [None, None]
    weights = [None if w is None else np.stack([w, w, w]) for w in (beta, alpha)]
    return solve_many(*rows, *ways, *weights).T_target_source[1]


def by_chunks(points, directions, beta, alpha):
    total = moments_of(np.zeros((0, 3)), np.zeros((0, 3)), *(directions or (None, None)), None, alpha)
    for i in range(0, len(points[0]), 3):
        part = None if beta is None else beta[i : i + 3]
        total = total + moments_of(points[0][i : i + 3], points[1][i : i + 3], point_weights=part)
    return solve_moments(total).T_target_source


def by_costs(points, directions, beta, alpha):
    k = len(points[0]) // 2
    parts = [slice(0, k), slice(k, None)]
    total = sum(PoseCost.points(points[0][s], points[1][s], None if beta is None else beta[s]) for s in parts)
    return (total + PoseCost.directions(*directions, alpha) if directions else total).minimise().T_target_source


WAYS = {"solve": by_solve, "solve_many": by_solve_many, "sums of chunks": by_chunks, "costs": by_costs}


def assert_digits(way, width, points, directions=None, beta=None, alpha=None) -> None:
    T = WAYS[way](points, directions, beta, alpha)
    exact = best_rotation(points, directions, beta, alpha)
    assert angle_between(T[:3, :3], exact) < FACTOR * EPS / width
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), rtol=0, atol=16 * EPS)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("width", [0.3, 0.05, 1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("position", ["along x", "general"])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_strip_keeps_the_digits_of_its_coordinates(way, width, position, noise):
    rng = np.random.default_rng(3)
    p = rng.uniform(-0.5, 0.5, (12, 3)) * [1.0, width, width]
    p = p if position == "along x" else p @ random_rotation(rng).T
    q = (p + noise * width * rng.normal(size=p.shape)) @ random_rotation(rng).T + rng.normal(size=3)
    assert_digits(way, width, (p, q), beta=rng.uniform(0.5, 2.0, 12) if noise else None)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("off_rad", [1e-5, 1e-7])
def test_two_points_and_a_normal_nearly_along_their_line(way, off_rad):
    rng = np.random.default_rng(5)
    V, R = random_rotation(rng), random_rotation(rng)
    p, m = np.array([[0.0, 0, 0], [1, 0, 0]]) @ V.T, np.array([[np.cos(off_rad), np.sin(off_rad), 0]]) @ V.T
    assert_digits(way, off_rad, (p, p @ R.T + 1.0), (m, m @ R.T))


@pytest.mark.parametrize("way", WAYS)
def test_one_point_and_two_directions_a_ten_thousandth_apart(way):
    rng = np.random.default_rng(6)
    V, R = random_rotation(rng), random_rotation(rng)
    m = np.array([[1.0, 0, 0], [np.cos(1e-4), np.sin(1e-4), 0]]) @ V.T
    assert_digits(way, 1e-4, (np.ones((1, 3)), np.zeros((1, 3))), (m, m @ R.T))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("ratio", [1e-8, 3e-12, 1e-15])
def test_a_light_direction_across_a_line_fixes_the_roll_as_well_as_a_heavy_one(way, ratio):
    rng = np.random.default_rng(7)
    V, R = random_rotation(rng), random_rotation(rng)
    p, m = np.outer([0.0, 1, 2, 5], [1.0, 0, 0]) @ V.T, np.array([[0.0, 0.6, 0.8]]) @ V.T
    assert_digits(way, 1.0, (p, p @ R.T), (m, m @ R.T), alpha=np.array([ratio]))


@pytest.mark.parametrize("way", WAYS)
def test_far_from_the_origin_the_rounding_of_the_coordinates_is_the_floor(way):
    rng = np.random.default_rng(8)
    p = rng.uniform(-0.5, 0.5, (12, 3)) * [1.0, 1e-3, 1e-3] @ random_rotation(rng).T + 1e4
    q = (p - 1e4) @ random_rotation(rng).T - 1e4
    assert_digits(way, 1e-3 / 1e4, (p, q))


@pytest.mark.parametrize("way", WAYS)
def test_a_line_stays_refused_in_any_position(way):
    rng = np.random.default_rng(9)
    for _ in range(5):
        p = np.outer(rng.uniform(-1, 1, 12), rng.normal(size=3))
        arguments = ((p, p @ random_rotation(rng).T), None, None, None)
        if way == "solve_many":
            assert np.isnan(by_solve_many(*arguments)).all()
        else:
            with pytest.raises(DegenerateGeometryError):
                WAYS[way](*arguments)


def test_narrow_is_the_ratio_of_two_singular_values():
    rng = np.random.default_rng(10)
    for scale in (1e-150, 1.0, 1e150):
        for ratio, narrow in ((0.5 * NARROW_RATIO, True), (2.0 * NARROW_RATIO, False)):
            H = scale * random_rotation(rng) @ np.diag([1.0, ratio, 0.1 * ratio]) @ random_rotation(rng)
            assert is_narrow(H) is narrow
    assert not is_narrow(np.zeros((3, 3)))
    A, B = long_axes(H)
    np.testing.assert_allclose([np.linalg.det(A), np.linalg.det(B)], 1.0, rtol=1e-14)
    np.testing.assert_allclose(B[:, 0] @ H @ A[:, 0], np.linalg.norm(H, 2), rtol=1e-14)
