"""Lobes and bows that few points were measured of: none is told as nothing."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.inspection.line_forms.profiles import Profile
from dqreg.inspection.line_forms.worst import worst_form

ZONE, NOISE, RADIUS = 0.1, 0.003, 8.0


@pytest.mark.parametrize("noise", [NOISE, 0.0])
@pytest.mark.parametrize("count", [8, 10, 12, 16, 24, 40])
def test_lobes_between_few_points_are_within_the_uncertainty(count: int, noise: float) -> None:
    for seed in range(20_000, 20_010):
        rng = np.random.default_rng(seed)
        turn = rng.uniform(0.0, 2.0 * np.pi) + np.arange(count) * 2.0 * np.pi / count
        turn = np.arctan2(np.sin(turn), np.cos(turn))
        for lobes in (2, 3):
            values = 0.5 * ZONE * np.cos(lobes * turn) + rng.normal(0.0, noise, count)
            found = worst_form([Profile(turn, values, RADIUS, np.zeros(3))], noise)
            assert abs(found.value - ZONE) <= found.uncertainty + NOISE
            assert found.decide(-np.inf, 0.5 * ZONE) != "pass"


@pytest.mark.parametrize("count", [8, 12, 24])
def test_a_bow_of_few_points_is_not_passed(count: int) -> None:
    along = np.linspace(0.0, 50.0, count)
    values = ZONE * (along / 25.0 - 1.0) ** 2 + np.random.default_rng(20_000).normal(0.0, NOISE, count)
    found = worst_form([Profile(along, values, 0.0, np.zeros(3))], NOISE)
    assert abs(found.value - ZONE) <= found.uncertainty
    assert found.decide(-np.inf, 0.5 * ZONE) in (("fail",) if count > 8 else ("fail", "undecided"))


def test_a_round_section_of_some_points_is_still_passed() -> None:
    turn = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    values = np.random.default_rng(20_000).normal(0.0, NOISE, 24)
    assert worst_form([Profile(turn, values, RADIUS, np.zeros(3))], NOISE).decide(-np.inf, 0.05) == "pass"
