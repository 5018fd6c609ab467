from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import pose
from dqreg.solvers import Fit, solve, solve_rotation
from tests.solvers.exact_oracle import random_rotation

INF = float("inf")
Rows = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def drawn(seed: int, points: list[int], directions: list[int], noise: float = 0.1) -> tuple[np.ndarray, Rows]:
    """A pose, and eight points and three directions with noise on all but the exact ones, whose rows are given."""
    rng = np.random.default_rng(seed)
    T = pose.from_parts(random_rotation(rng), rng.uniform(-5, 5, 3))
    p, m = rng.normal(size=(8, 3)), rng.normal(size=(3, 3))
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    q, n = pose.apply(T, p), m @ T[:3, :3].T
    beta, alpha = rng.uniform(0.5, 2, 8), rng.uniform(0.5, 2, 3)
    loose = [np.setdiff1d(np.arange(8), points), np.setdiff1d(np.arange(3), directions)]
    q[loose[0]] += noise * rng.normal(size=(len(loose[0]), 3))
    n[loose[1]] += noise * rng.normal(size=(len(loose[1]), 3))
    beta[points], alpha[directions] = INF, INF
    return T, (p, q, m, n, beta, alpha)


def miss(fit: Fit, rows: Rows) -> float:
    """Largest residual of the exact matches."""
    p, q, m, n, beta, alpha = rows
    away = pose.apply(fit.T_target_source, p)[beta == INF] - q[beta == INF]
    tilt = (m @ fit.T_target_source[:3, :3].T)[alpha == INF] - n[alpha == INF]
    return float(np.abs(np.vstack([away, tilt])).max(initial=0.0))


EXACT = {
    "a point": ([2], []),
    "a direction": ([], [1]),
    "a point and a direction": ([2], [1]),
    "two points": ([0, 5], []),
    "two directions": ([], [0, 2]),
    "two points and a direction": ([0, 5], [1]),
    "three points": ([0, 5, 6], []),
    "all points": ([0, 1, 2, 3, 4, 5, 6, 7], []),
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", EXACT)
def test_exact_matches_are_met_and_the_rest_is_the_limit_of_large_weights(case: str, seed: int) -> None:
    T, rows = drawn(seed, *EXACT[case])
    fit = solve(*rows)
    assert miss(fit, rows) < 1e-14 * 30
    beta, alpha = (np.where(w == INF, 1e11, w) for w in rows[4:])
    # The limit comes near as 1 / weight, and its own sums round at 1e-16 of the large ones.
    np.testing.assert_allclose(fit.T_target_source, solve(*rows[:4], beta, alpha).T_target_source, rtol=0, atol=1e-8)
    loose = np.isfinite(rows[4])
    away = pose.apply(fit.T_target_source, rows[0]) - rows[1]
    point_cost = float(rows[4][loose] @ (away[loose] ** 2).sum(axis=1))
    rms = np.sqrt(point_cost / rows[4][loose].sum()) if loose.any() else 0.0
    assert fit.rms == pytest.approx(rms, rel=1e-12)
    if case in ("three points", "all points", "two points and a direction"):
        np.testing.assert_allclose(fit.T_target_source, T, rtol=0, atol=1e-13)
        assert not fit.covariance.any()


@pytest.mark.parametrize("case", ["a point", "a point and a direction", "two points", "a direction"])
def test_the_rotation_is_that_of_scipy_about_the_exact_point(case: str) -> None:
    _, rows = drawn(7, *EXACT[case])
    p, q, m, n, beta, alpha = rows
    points = beta == INF
    origin = points.astype(float) if points.any() else beta
    a, b = (side - origin @ side / origin.sum() for side in (p, q))
    # SciPy takes one infinite weight: the exact points lie on one line through their mean.
    keep = np.flatnonzero(~points) if points.sum() != 2 else np.append(np.flatnonzero(~points), np.argmax(points))
    w = np.concatenate([beta[keep], alpha])
    theirs = Rotation.align_vectors(np.vstack([b[keep], n]), np.vstack([a[keep], m]), w)[0].as_matrix()
    np.testing.assert_allclose(solve(*rows).T_target_source[:3, :3], theirs, rtol=0, atol=1e-13)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize(("case", "free"), [("a point", 3), ("a direction", 4), ("two points", 1)])
def test_errors_are_as_large_as_the_covariance_says(case: str, free: int, absolute: bool) -> None:
    trials, sigma, total = 150, 0.01, 0.0
    for k in range(trials):
        T, (p, q, m, n, beta, alpha) = drawn(k + 1000, *EXACT[case], noise=sigma)
        beta, alpha = (np.where(w == INF, w, 1 / sigma**2) for w in (beta, alpha))
        fit = solve(p, q, m, n, beta, alpha, absolute_weights=absolute)
        # The left increment about the centre that leads from the answer to the truth.
        about = pose.from_parts(np.eye(3), fit.centre)
        e = pose.log(pose.inverse(about) @ T @ pose.inverse(fit.T_target_source) @ about)
        total += e @ np.linalg.pinv(fit.covariance, hermitian=True, rcond=1e-9) @ e
    # Mean of a chi-square; noise that is estimated from some twenty residuals adds a tenth.
    assert total / trials == pytest.approx(free, abs=3.5 * np.sqrt(2 * free / trials) + (0 if absolute else 0.1 * free))


def test_far_from_the_origin_the_exact_point_is_met_as_its_coordinates_are() -> None:
    # Binary fractions stay exact far away.
    p = np.round(np.random.default_rng(3).normal(size=(8, 3)) * 2**20) / 2**20 + 1e6
    beta = np.array([1.0, 1, INF, 1, INF, 1, 1, 1])
    fit = solve(p, p + 1e6, None, None, beta)
    np.testing.assert_allclose(fit.T_target_source[:3, :3], np.eye(3), rtol=0, atol=1e-13)
    same = np.vstack([p, p[2]]), np.vstack([p + 1e6, p[2] + 1e6])
    # A copy of an exact point, and one between two of them, add nothing but rounding.
    middle = p[2] / 2 + p[4] / 2
    same = np.vstack([same[0], middle]), np.vstack([same[1], middle + 1e6])
    twice = solve(*same, None, None, np.append(beta, [INF, INF]))
    np.testing.assert_allclose(twice.T_target_source[:3, :3], np.eye(3), rtol=0, atol=1e-13)


def test_two_exact_directions_hold_the_rotation_also_where_they_are_nearly_parallel() -> None:
    m = np.array([[1.0, 0, 0], [np.cos(0.1), np.sin(0.1), 0], [0, 0, 1]])
    n = m.copy()
    n[2] = [0, 0.6, 0.8]
    fit = solve_rotation(m, n, [INF, INF, 1.0])
    np.testing.assert_allclose(fit.R_target_source, np.eye(3), rtol=0, atol=1e-13)


P = np.random.default_rng(5).normal(size=(5, 3))
LINE = np.outer(np.arange(4.0), [1.0, 2, 3])
BAD = {
    "lengths": (InputError, (P, P * [1, 1, 1.001], None, None, [INF, INF, 1, 1, 1]), "contradict each other"),
    "angles": (InputError, (P, P, P[:2], P[[0, 2]], None, INF), "contradict each other"),
    "one place and two": (InputError, (P[[0, 0, 1, 2]], P[[0, 3, 1, 2]], None, None, [INF, INF, 1, 1]), "contradict"),
    "on a line": (DegenerateGeometryError, (LINE, LINE, None, None, [INF, 1, 1, 1]), "leave a rotation open"),
    "about the axis": (DegenerateGeometryError, (LINE, LINE, None, None, [INF, INF, 1, 1]), "leave a rotation open"),
    "no point": (DegenerateGeometryError, (P, P, P, P, 0.0, INF), "no matched point carries weight"),
    "rows": (InputError, (P, P, None, None, [INF, 1]), "one number or 5 numbers"),
    "directions missing": (InputError, (P, P, None, None, None, INF), "without directions"),
    "NaN": (InputError, (P, P, None, None, [INF, np.nan, 1, 1, 1]), "NaN"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_met_is_named(case: str) -> None:
    error, arguments, words = BAD[case]
    with pytest.raises(error, match=words):
        solve(*arguments)


def strip(width: float, tilt: float = 0.0) -> tuple[np.ndarray, Rows]:
    """A turn, a strip before and after it, and its length, which errs by an angle for itself on either side."""
    rng = np.random.default_rng(20011)
    turn, axes = random_rotation(rng), random_rotation(rng)
    p = np.column_stack([rng.uniform(-1, 1, 200), width * rng.uniform(-1, 1, 200), np.zeros(200)]) @ axes.T
    m, n = (axes[:, :1].T + tilt * rng.normal(size=3) for _ in range(2))
    return turn, (p, p @ turn.T, m, n @ turn.T, np.ones(200), np.array([INF]))


@pytest.mark.parametrize("width", [1e-3, 1e-5, 1e-6, 3e-7, 1e-7])
def test_a_strip_whose_length_is_known_has_the_pose_that_it_has_without(width: float) -> None:
    turn, rows = strip(width)
    without, beside = solve(*rows[:2]), solve(*rows)
    for fit in (without, beside):
        # The grain of coordinates, 8 eps of the length, over the width.
        off = Rotation.from_matrix(fit.T_target_source[:3, :3] @ turn.T).magnitude()
        assert off < 8.0 * np.finfo(np.float64).eps / width
    assert beside.eigenvalue_gap == pytest.approx(without.eigenvalue_gap, rel=0.2)


@pytest.mark.parametrize("width", [0.0, 1e-10])
def test_what_lies_along_an_exact_direction_as_far_as_that_is_known_holds_no_rotation(width: float) -> None:
    # Typed to nine digits on either side, a direction tells no more of a line beside it than chance.
    _, rows = strip(width, tilt=1e-10)
    with pytest.raises(DegenerateGeometryError, match="leave a rotation open"):
        solve(*rows)


def test_a_direction_parallel_to_an_exact_one_holds_no_rotation() -> None:
    m = np.array([[1.0, 2, 3], [1, 2, 3], [1 + 1e-15, 2, 3]])
    with pytest.raises(DegenerateGeometryError, match=r"beside one exact direction .* Add a direction across it"):
        solve_rotation(m, m, [INF, 1.0, 1.0])
