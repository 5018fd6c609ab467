from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.optimize import minimize

from dqreg.errors import InputError
from dqreg.rigid import DualNumber, DualQuaternion, lines, pose
from tests.strategies import points, poses, unit_vectors

fast = settings(deadline=None, max_examples=40)


def dual_product(a, b):
    """Scalar product of two dual vectors n + eps m."""
    return DualNumber(float(a[:3] @ b[:3]), float(a[:3] @ b[3:] + a[3:] @ b[:3]))


@fast
@given(points(2), unit_vectors(), unit_vectors())
def test_equations_10_52_and_57_the_dual_cosine_is_the_scalar_product(p, n1, n2):
    # Walker eq. 52.
    a, b = lines.through(p[0], n1), lines.through(p[1], n2)
    assume(np.linalg.norm(np.cross(n1, n2)) > 1e-3)
    cosine, length = lines.dual_angle(a, b).cos(), 1 + np.abs(p).max()
    assert cosine.real == pytest.approx(dual_product(a, b).real, abs=1e-14)
    assert cosine.dual == pytest.approx(dual_product(a, b).dual, abs=1e-11 * length)


def test_the_distance_is_the_smallest_of_any_two_points():
    rng = np.random.default_rng(3)
    for _ in range(5):
        (p, q), (m, n) = rng.uniform(-5, 5, (2, 3)), rng.standard_normal((2, 3))
        a, b = lines.through(p, m), lines.through(q, n)
        found = minimize(lambda x: np.sum((p + x[0] * m - q - x[1] * n) ** 2), [0, 0], tol=1e-14).x  # noqa: B023
        apart = q + found[1] * n - p - found[0] * m
        assert abs(lines.dual_angle(a, b).dual) == pytest.approx(np.linalg.norm(apart), abs=1e-6)
        across = lines.common_perpendicular(a, b)
        np.testing.assert_allclose(np.cross(p + found[0] * m, across[:3]), across[3:], atol=1e-5)


@fast
@given(points(2), unit_vectors(), unit_vectors(), poses())
def test_the_screw_between_two_lines_puts_one_on_the_other(p, n1, n2, T):
    a, b, length = lines.through(p[0], n1), lines.through(p[1], n2), 1 + np.abs(p).max()
    sine = np.linalg.norm(np.cross(n1, n2))
    assume(sine == 0.0 or sine > 1e-6)  # the foot of nearly parallel lines lies anywhere
    motion = lines.screw_between(a, b)
    np.testing.assert_allclose(motion.move_lines(a), b, rtol=0, atol=1e-9 * length)
    # The dual angle is the screw's, and no common motion changes it.
    angle, screw = lines.dual_angle(a, b), motion.as_screw()
    assert screw.angle_rad == pytest.approx(angle.real, abs=1e-12)
    if sine > 0.0:
        moved = lines.dual_angle(pose.move_lines(T, a), pose.move_lines(T, b))
        assert moved.real == pytest.approx(angle.real, abs=1e-12)
        reach = length + np.linalg.norm(T[:3, 3])
        assert moved.dual == pytest.approx(angle.dual, abs=1e-13 * reach / sine**2)


def test_parallel_equal_and_opposite_lines():
    a = lines.through([0, 0, 0], [0, 0, 1])
    for b, theta, d in (
        (lines.through([3, 4, 9], [0, 0, 1]), 0.0, 5.0),
        (lines.through([3, 4, 9], [0, 0, -1]), np.pi, 5.0),
        (a, 0.0, 0.0),
        (lines.through([0, 0, 7], [0, 0, -1]), np.pi, 0.0),
    ):
        angle = lines.dual_angle(a, b)
        assert (angle.real, angle.dual) == pytest.approx((theta, d), abs=1e-15)
        np.testing.assert_allclose(lines.screw_between(a, b).move_lines(a), b, atol=1e-14)
    assert lines.screw_between(a, a).isclose(DualQuaternion.identity())


def test_stacks_of_lines():
    rng = np.random.default_rng(5)
    a = lines.through(rng.standard_normal((4, 3)), rng.standard_normal((4, 3)))
    b = lines.joining(rng.standard_normal(3), rng.standard_normal(3))
    whole, moved = lines.dual_angle(a, b), lines.screw_between(a, b).move_lines(a)
    assert whole.real.shape == (4,)
    for k in range(4):
        assert whole.dual[k] == pytest.approx(lines.dual_angle(a[k], b).dual, abs=1e-14)
    np.testing.assert_allclose(moved, np.broadcast_to(b, (4, 6)), atol=1e-13)
    there = lines.nearest_point(a, [1, 2, 3])
    np.testing.assert_allclose(np.cross(there, a[:, :3]), a[:, 3:], atol=1e-14)
    np.testing.assert_allclose(np.sum((there - [1, 2, 3]) * a[:, :3], axis=1), 0, atol=1e-14)


def test_errors():
    with pytest.raises(InputError, match="direction"):
        lines.joining([1, 2, 3], [1, 2, 3])
    with pytest.raises(InputError, match="a must have a direction"):
        lines.dual_angle(np.zeros(6), lines.through([0, 0, 0], [1, 0, 0]))
    with pytest.raises(InputError, match="direction and moment"):
        lines.nearest_point([1, 2, 3])
