from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.synth.parts import box, bracket
from dqreg.trust.chance import places_of, random_ratio
from dqreg.trust.limits import CHANCE_RATIO, MIN_INLIERS

PART = Mesh(*box((100.0, 60.0, 40.0)))
SURFACE = MeshSurface(PART)
BRACKET = Mesh(*bracket())


def ratio(points: np.ndarray, inlying: float = 1.0) -> float:
    distances = np.sort(SURFACE.closest(points).distances)[: round(inlying * len(points))]
    return random_ratio(points, inlying, float(np.sqrt(np.mean(distances**2))), SURFACE)


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.4, 1.0])
def test_points_of_the_part_are_far_below_chance(noise: float) -> None:
    rng = np.random.default_rng(0)
    points = sample_mesh(PART, 300, rng).points
    assert ratio(points + noise * rng.normal(size=points.shape)) <= 0.5 * CHANCE_RATIO


def test_points_that_follow_no_shape_are_near_chance() -> None:
    points = np.random.default_rng(0).normal(size=(300, 3)) * 20 + PART.centre
    assert ratio(points) >= 2.0 * CHANCE_RATIO


def test_it_is_the_same_in_any_unit_and_every_time() -> None:
    points = sample_mesh(PART, 300, np.random.default_rng(1)).points + 0.5
    again = random_ratio(1e3 * points, 1.0, 1e3 * 0.5, MeshSurface(Mesh(1e3 * PART.vertices, PART.faces)))
    assert random_ratio(points, 1.0, 0.5, SURFACE) == pytest.approx(again, rel=1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e6])
@pytest.mark.parametrize("shift", [0.0, 5e6])
def test_places_are_counted_once_however_often_they_were_measured(scale: float, shift: float) -> None:
    rng = np.random.default_rng(2)
    grid = scale * (np.stack(np.meshgrid(*[np.arange(3.0)] * 3), axis=-1).reshape(-1, 3) + shift)
    assert places_of(np.zeros((0, 3))) == 0
    assert places_of(grid) == len(grid)
    # A cluster may lie across the borders of cells.
    often = np.repeat(grid, 30, axis=0) + 1e-4 * scale * rng.normal(size=(30 * len(grid), 3))
    assert len(grid) <= places_of(rng.permutation(often)) <= 8 * len(grid)


def test_points_all_over_a_part_are_as_many_places() -> None:
    points = sample_mesh(PART, 20_000, np.random.default_rng(3)).points
    assert places_of(points) >= 5 * MIN_INLIERS


def test_a_dozen_places_that_fit_by_chance_are_not_enough_however_many_points() -> None:
    """Twelve points of the part, of which each was measured 40 times, from the truth (identity): nothing checks it."""
    rng = np.random.default_rng(4)
    points = np.repeat(sample_mesh(PART, 12, rng).points, 40, axis=0) + 0.02 * rng.normal(size=(480, 3))
    found = dqreg.register(points, PART, "identity", effort="fast", units="ignore")
    assert found.verdict.level != "accepted"
    assert "few_inliers" in found.verdict.codes


@pytest.mark.parametrize("count", [120])
@pytest.mark.parametrize(
    ("part", "kind"),
    [
        pytest.param(PART, "gauss", id="box-gauss"),
        pytest.param(BRACKET, "shell", id="bracket-shell"),
        *(
            pytest.param(part, kind, marks=pytest.mark.soak)
            for part, kind in ((PART, "shell"), (PART, "ball"), (BRACKET, "gauss"), (BRACKET, "ball"))
        ),
    ],
)
def test_noise_is_not_accepted(part: Mesh, count: int, kind: str) -> None:
    points = np.random.default_rng(count).normal(size=(count, 3))
    if kind != "gauss":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    if kind == "ball":
        points *= np.random.default_rng(1).random((count, 1)) ** (1 / 3)
    points *= part.diagonal * (0.16 if kind == "gauss" else 0.3)
    assert dqreg.register(points, part, "identity", effort="fast", units="ignore").verdict.level != "accepted"
