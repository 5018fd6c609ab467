from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.icp.acceleration import TOLERATED_RISE_OF_PLANES, Anderson
from dqreg.rigid import pose, twist
from tests.icp.scenes import motion

CENTRE, SIZE = np.array([3.0, -1.0, 2.0]), 2.0
UNITS = np.r_[1.0, 1.0, 1.0, [SIZE] * 3]


def frame_of(T: FloatArray) -> FloatArray:
    frame = np.eye(4)
    frame[:3, 3] = pose.apply(T, CENTRE)
    return frame


def proposed(anderson: Anderson, T: FloatArray, T_next: FloatArray, energy: float) -> tuple[FloatArray, bool]:
    """Where a loop goes on that does not end, and whether the extrapolation before holds."""
    back = anderson.taken_back(T, T_next, energy)
    return (anderson.ahead(T_next), True) if back is None else (back, False)


def run(matrix: FloatArray, first: FloatArray, steps: int) -> list[float]:
    """Distances from the fixed point of x -> M x, in the coordinates that the docstring names."""
    reference = motion(0.5, 1.0)
    frame = frame_of(reference)
    place = lambda x: frame @ twist.exp(x * UNITS) @ pose.inverse(frame) @ reference  # noqa: E731
    read = lambda T: twist.log(pose.inverse(frame) @ T @ pose.inverse(reference) @ frame) / UNITS  # noqa: E731
    anderson = Anderson(reference, CENTRE, SIZE)
    x, gaps = first, []
    for step in range(steps):
        gaps.append(float(np.linalg.norm(x)))
        # A falling energy: the guard is not asked here.
        T_new, sound = proposed(anderson, place(x), place(matrix @ x), energy=1.0 / (step + 1))
        assert sound
        x = read(T_new)
    return gaps


def test_a_linear_contraction_jumps_to_its_fixed_point() -> None:
    # Six unknowns, a window of five differences and one plain step: there after seven steps, where the plain
    # iteration, which shrinks by 0.97, would need 600 for eight digits.
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    matrix = Q @ np.diag([0.97, 0.9, 0.8, 0.5, 0.3, 0.0]) @ Q.T
    gaps = run(matrix, 1e-2 * rng.standard_normal(6), steps=12)
    assert gaps[7] <= 1e-8 * gaps[0]
    assert gaps[1] >= 0.1 * gaps[0]  # the first step is plain


def test_one_slow_direction_takes_two_steps() -> None:
    direction = np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.1])
    gaps = run(0.99 * np.eye(6), 0.1 * direction, steps=4)
    assert gaps[1] == pytest.approx(0.99 * gaps[0], rel=1e-9)
    assert gaps[2] <= 1e-9 * gaps[0]


def test_the_first_answer_is_the_plain_step_as_it_is() -> None:
    anderson = Anderson(np.eye(4), CENTRE, SIZE)
    T_next = motion(0.1, 0.1)
    T_new, sound = proposed(anderson, np.eye(4), T_next, energy=1.0)
    assert sound
    np.testing.assert_array_equal(T_new, T_next)


def test_a_raised_energy_brings_back_the_plain_step_and_forgets() -> None:
    anderson = Anderson(np.eye(4), CENTRE, SIZE)
    first, second, third = (motion(0.1 / k, 0.1 / k, seed=k) for k in (1, 2, 3))
    proposed(anderson, np.eye(4), first, energy=4.0)
    extrapolated, sound = proposed(anderson, first, second, energy=3.0)
    assert sound
    assert np.abs(extrapolated - second).max() > 1e-3
    back, sound = proposed(anderson, extrapolated, third, energy=3.5)
    assert not sound
    np.testing.assert_array_equal(back, second)
    # Forgotten: whatever comes next is a first step again, whatever its energy.
    T_new, sound = proposed(anderson, back, third, energy=100.0)
    assert sound
    np.testing.assert_array_equal(T_new, third)


@pytest.mark.parametrize(("way", "is_sound"), [(0.01, True), (0.3, False)])
def test_of_planes_energies_may_rise_a_little_while_the_steps_get_shorter(way: float, is_sound: bool) -> None:
    anderson = Anderson(np.eye(4), CENTRE, SIZE, tolerated=TOLERATED_RISE_OF_PLANES)
    first, second = motion(0.08, 0.08), motion(0.12, 0.12)
    proposed(anderson, np.eye(4), first, energy=1.0)
    extrapolated, _ = proposed(anderson, first, second, energy=1.005)
    assert np.linalg.norm(extrapolated - second) > 1e-2
    # The step before was one of 0.04.
    third = motion(way, 0.0, seed=1) @ extrapolated
    assert proposed(anderson, extrapolated, third, energy=1.01)[1] is is_sound


def test_equal_energies_and_their_rounding_are_no_rise() -> None:
    anderson = Anderson(np.eye(4), CENTRE, SIZE)
    proposed(anderson, np.eye(4), motion(0.1, 0.1), energy=1.0)
    _, sound = proposed(anderson, motion(0.1, 0.1), motion(0.15, 0.15), energy=1.0)
    T_new, sound = proposed(anderson, motion(0.17, 0.17), motion(0.16, 0.17), energy=1.0 + 1e-13)
    assert sound
    assert np.isfinite(T_new).all()


def test_a_plain_step_that_raises_the_energy_is_not_taken_back() -> None:
    # Nothing was extrapolated, so there is nothing better to go back to.
    anderson = Anderson(np.eye(4), CENTRE, SIZE)
    proposed(anderson, np.eye(4), motion(0.1, 0.1), energy=1.0)
    _, sound = proposed(anderson, motion(0.1, 0.1), motion(0.2, 0.1), energy=2.0)
    assert sound


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(1e-9, 1.0))
def test_proposals_are_rigid(seed: int, step: float) -> None:
    anderson = Anderson(motion(1.0, 5.0, seed), CENTRE, SIZE)
    T = motion(1.0, 5.0, seed)
    for k in range(8):
        T_next = motion(step, step, seed + k) @ T
        T, _ = proposed(anderson, T, T_next, energy=1.0 / (k + 1))
        R = T[:3, :3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0.0
        np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])


def test_no_motion_stays_where_it_is() -> None:
    anderson = Anderson(motion(0.3, 1.0), CENTRE, SIZE)
    T = motion(0.3, 1.0)
    for _ in range(4):
        T_new, sound = proposed(anderson, T, T, energy=0.0)
        assert sound
        np.testing.assert_allclose(T_new, T, atol=1e-14)


def test_lengths_may_be_in_any_unit() -> None:
    k = 1000.0
    scaled = lambda T: np.block([[T[:3, :3], k * T[:3, 3:]], [T[3:]]])  # noqa: E731
    small, large = Anderson(np.eye(4), CENTRE, SIZE), Anderson(np.eye(4), k * CENTRE, k * SIZE)
    T = np.eye(4)
    for n in range(5):
        T_next = motion(0.1 / (n + 1), 0.1 / (n + 1), seed=n) @ T
        energy = 1.0 / (n + 1)
        T_small, _ = proposed(small, T, T_next, energy)
        T_large, _ = proposed(large, scaled(T), scaled(T_next), k**2 * energy)
        np.testing.assert_allclose(T_large, scaled(T_small), rtol=1e-9, atol=1e-9)
        T = T_small
