from __future__ import annotations

import numpy as np

from dqreg.rigid import pose
from dqreg.synth.many_views import street_drive
from dqreg.synth.parts import box
from dqreg.synth.street import swept, with_range_noise

ELEVATIONS, AZIMUTHS = np.deg2rad([-20.0, -5.0, 3.0]), np.linspace(-np.pi, np.pi, 36, endpoint=False)


def test_each_beam_of_a_sweep_ends_on_the_walls_at_its_own_angles_ring_by_ring() -> None:
    # From anywhere in a closed box all beams meet it.
    room, T = box((8.0, 6.0, 4.0)), pose.exp(np.array([0.1, -0.2, 0.7, 0.5, -0.3, 0.2]))
    seen = swept(room, T, ELEVATIONS, AZIMUTHS)
    x, y, z = seen.T
    np.testing.assert_allclose(np.arctan2(z, np.hypot(x, y)), np.repeat(ELEVATIONS, 36), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * np.arctan2(y, x)), np.tile(np.exp(1j * AZIMUTHS), 3), rtol=0.0, atol=1e-12)
    walls = np.abs(pose.apply(T, seen)) / [4.0, 3.0, 2.0]
    np.testing.assert_allclose(walls.max(axis=1), 1.0, rtol=0.0, atol=1e-12)


def test_noise_is_along_the_beams_and_as_large_as_asked() -> None:
    points = np.random.default_rng(0).normal(size=(20_000, 3)) * 30.0
    noisy = with_range_noise(points, 0.02, np.random.default_rng(1))
    np.testing.assert_allclose(np.cross(noisy, points), 0.0, atol=1e-9)
    off = np.linalg.norm(noisy, axis=1) - np.linalg.norm(points, axis=1)
    # Five standard errors of a standard deviation from 20,000 values.
    assert abs(off.std() / 0.02 - 1.0) < 5.0 / np.sqrt(2.0 * len(points))


def test_a_car_goes_along_the_street_upright_by_about_its_step() -> None:
    made = street_drive(12, step=0.8, rings=4, noise=0.0, rng=np.random.default_rng(0))
    steps = np.linalg.norm(np.diff(made.T_world_scan[:, :2, 3], axis=0), axis=1)
    assert ((steps > 0.9 * 0.8 - 1e-12) & (steps < 1.1 * 0.8 + 1e-12)).all()
    assert (made.T_world_scan[:, 2, 2] > np.cos(np.deg2rad(2.0))).all()
    assert (np.abs(made.T_world_scan[:, 1, 3]) < 5.0).all()
