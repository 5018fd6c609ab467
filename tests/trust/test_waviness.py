"""What neighbouring residuals have in common: waves, and noise that neighbours share; of noise nothing."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.trust.waviness import common_share, waviness_of

WIDTH = 0.01
UP = np.tile([0.0, 0.0, 1.0], (2_000, 1))


def test_waves_are_what_neighbours_have_in_common_and_noise_is_not() -> None:
    rng = np.random.default_rng(0)
    x, up = np.linspace(0.0, 1.0, 2_000), UP
    # A wave of ten periods: neighbours four points apart differ in phase by 7 degrees at most.
    wave = 3.0 * WIDTH * np.sin(20.0 * np.pi * x)
    noise = WIDTH * rng.normal(size=(100, len(x)))
    alone, both = ([waviness_of(row, up) for row in rows] for rows in (noise, wave + noise))
    assert [shared for shared, _ in alone] == [0.0] * 100
    assert [shared for shared, _ in both] == pytest.approx([3.0 * WIDTH / np.sqrt(2.0)] * 100, rel=0.05)
    # The noise is known whether there is a wave or not, and to a factor of two beside a sheet of 30 % of the points.
    sheet = np.where(rng.uniform(size=len(x)) < 0.3, 8.0 * WIDTH, 0.0)
    for found in (alone, both):
        assert [own for _, own in found] == pytest.approx([WIDTH] * 100, rel=0.12)
    assert all(WIDTH < waviness_of(row + sheet, up)[1] < 2.0 * WIDTH for row in noise)
    # The same residuals in another order have nothing in common; few say nothing.
    assert waviness_of(rng.permutation(wave), up)[0] == 0.0
    assert np.isnan(waviness_of(wave[:100], up[:100])[1])


@pytest.mark.parametrize("shared", [0.0, 0.3, 1.0, 3.0])
def test_of_noise_that_neighbours_share_they_have_its_share_of_the_variance_in_common(shared: float) -> None:
    """Oracle: s^2 / (1 + s^2) of s times as much as there is from point to point, in patches of 40."""
    rng = np.random.default_rng(0)
    found = [common_share(rng.normal(size=2_000) + shared * np.repeat(rng.normal(size=50), 40), UP) for _ in range(50)]
    # Neighbours are one and three points apart: one pair in twenty is across two patches.
    assert np.mean(found) == pytest.approx(0.95 * shared**2 / (1.0 + shared**2), abs=0.02)


def test_too_few_neighbours_tell_no_noise() -> None:
    assert common_share(np.random.default_rng(0).normal(size=50), UP[:50]) == 1.0
