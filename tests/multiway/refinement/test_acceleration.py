"""Extrapolation of many poses at once, on iterations whose limit is known."""

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.refinement.acceleration import JointAnderson
from dqreg.rigid import pose

COUNT, ROUNDS = 5, 12


def limit_and_start() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(3)
    limit = np.stack([pose.random(rng, reach=50.0) for _ in range(COUNT)])
    off = pose.exp(1e-3 * rng.normal(size=(COUNT, 6)))
    middle = pose.from_parts(np.eye(3), -limit[:, :3, 3])
    return limit, pose.inverse(middle) @ off @ middle @ limit


def nearer(T: FloatArray, limit: FloatArray) -> FloatArray:
    """One plain round: two motions of all poses together keep nine tenths and two thirds, the others a tenth."""
    middle = pose.from_parts(np.eye(3), -limit[:, :3, 3])
    left = pose.log(middle @ T @ pose.inverse(limit) @ pose.inverse(middle)).ravel()
    basis = np.linalg.qr(np.random.default_rng(7).normal(size=(6 * COUNT, 2)))[0]
    slow = basis @ (np.array([0.9, 0.66]) * (basis.T @ left))
    kept = slow + 0.1 * (left - basis @ (basis.T @ left))
    return np.asarray(pose.inverse(middle) @ pose.exp(kept.reshape(-1, 6)) @ middle @ limit)


def off(T: FloatArray, limit: FloatArray) -> float:
    return float(np.abs(T - limit).max())


def test_a_slow_iteration_comes_to_its_limit() -> None:
    limit, T = limit_and_start()
    plain = T
    faster = JointAnderson(np.arange(COUNT), np.ones(COUNT))
    for _ in range(ROUNDS):
        plain = nearer(plain, limit)
        T = faster.propose(T, nearer(T, limit))
    # The plain rounds keep 0.9^12 of the slow motion, 0.28.
    assert off(T, limit) < 1e-3 * off(plain, limit)


def test_a_body_that_is_held_stays() -> None:
    limit, T = limit_and_start()
    held, faster = T[0].copy(), JointAnderson(np.arange(1, COUNT), np.ones(COUNT))
    for _ in range(4):
        new = nearer(T, limit)
        new[0] = held
        T = faster.propose(T, new)
    np.testing.assert_array_equal(T[0], held)


def test_an_extrapolation_after_which_the_steps_grow_is_taken_back() -> None:
    limit, T = limit_and_start()
    faster = JointAnderson(np.arange(COUNT), np.ones(COUNT))
    first = nearer(T, limit)
    T = faster.propose(T, first)
    plain = nearer(T, limit)
    extrapolated = faster.propose(T, plain)
    assert off(extrapolated, plain) > 0.0
    far = pose.exp(np.full((COUNT, 6), 0.1)) @ extrapolated
    np.testing.assert_array_equal(faster.propose(extrapolated, far), plain)
