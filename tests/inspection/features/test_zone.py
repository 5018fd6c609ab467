"""Inscribed and circumscribed shapes: answered where points surround them, refused where they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError
from dqreg.inspection.features import FeatureKind, fit_feature

RADIUS, NOISE = 2.0, 0.01
ROUND: tuple[FeatureKind, ...] = ("circle", "cylinder", "sphere")
METHODS: tuple[Any, ...] = ("inscribed", "circumscribed")


def opened(kind: str, degrees: float, seed: int = 0, noise: float = NOISE) -> np.ndarray:
    """Sixty points of a shape of which an arc, or a cap of a sphere with that opening angle, is measured."""
    rng = np.random.default_rng(seed)
    arc, turns = np.radians(degrees), rng.uniform(size=60)
    radius = RADIUS + noise * rng.normal(size=60)
    if kind == "sphere":
        height, turn = rng.uniform(np.cos(0.5 * arc), 1.0, 60), 2.0 * np.pi * turns
        across = np.sqrt(1.0 - height**2)
        return radius[:, None] * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    z = rng.uniform(-3.0, 3.0, 60) if kind == "cylinder" else np.zeros(60)
    return np.column_stack([radius * np.cos(arc * turns), radius * np.sin(arc * turns), z])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ROUND)
@pytest.mark.parametrize("degrees", [120.0, 175.0])
def test_a_shape_that_points_do_not_surround_is_refused(kind: FeatureKind, method: Any, degrees: float) -> None:
    with pytest.raises(DegenerateGeometryError, match=f"the {method} {kind} .* do not surround it"):
        fit_feature(opened(kind, degrees), kind, method=method)


@pytest.mark.parametrize("degrees", [190.0, 200.0])
def test_what_reaches_round_by_little_is_held_or_refused(degrees: float) -> None:
    # A few degrees beyond half at each end: of exact points a largest circle, of noisy ones it slides out or not.
    exact = fit_feature(opened("circle", degrees, noise=0.0), "circle", method="inscribed")
    assert exact.radius == pytest.approx(RADIUS)
    answered = 0
    for seed in range(6):
        try:
            found = fit_feature(opened("circle", degrees, seed), "circle", method="inscribed")
        except DegenerateGeometryError as error:
            assert "by less than their form error" in str(error)  # noqa: PT017 - either is right
        else:
            answered += 1
            # As where points surround it.
            assert 0.0 < RADIUS - found.radius < 4.0 * NOISE
    assert answered == 6 or degrees < 200.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ROUND)
@pytest.mark.parametrize("degrees", [240.0, pytest.param(360.0, marks=pytest.mark.soak)])
def test_a_shape_that_points_surround_is_answered(kind: FeatureKind, method: Any, degrees: float) -> None:
    # The extremes of sixty points lie two to four standard deviations off, and the stated sigma is below the noise.
    found = fit_feature(opened(kind, degrees), kind, method=method)
    side = 1.0 if method == "circumscribed" else -1.0
    assert 0.0 < side * (found.radius - RADIUS) < 4.0 * NOISE
    assert 0.1 * NOISE < found.sigma("radius") < NOISE


def test_two_points_across_hold_an_oval() -> None:
    # The least circle about an ellipse touches the ends of its long axis alone, the largest within those of the short.
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    oval = np.column_stack([2.1 * np.cos(angle), 1.9 * np.sin(angle), np.zeros(60)])
    assert fit_feature(oval, "circle", method="circumscribed").radius == pytest.approx(2.1, abs=1e-9)
    assert fit_feature(oval, "circle", method="inscribed").radius == pytest.approx(1.9, abs=1e-9)
