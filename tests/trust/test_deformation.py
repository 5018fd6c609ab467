"""Deformations between two clouds of one corner: told all together where no single strain is known."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.compare.trust.kinds import KINDS
from dqreg.registration.register import register
from dqreg.rigid import pose, twist
from dqreg.trust import deformation
from dqreg.trust.deformation import ON_A_PART, Limit, Limits, deformation_of, may_be_deformed
from tests.strategies import FloatArray
from tests.trust.shapes import sphere

SIZE, NOISE = 3.0, 1e-3


def corner(rng: np.random.Generator, count: int = 1_500) -> tuple[FloatArray, FloatArray]:
    """Places on three faces that meet in the origin at 75 to 90 degrees, in the order of the faces, and normals."""
    normals = np.array([[1.0, 0.0, 0.0], [0.17, 0.985, 0.0], [0.25, 0.1, 0.96]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.cross(np.roll(normals, -1, axis=0), np.roll(normals, 1, axis=0))
    rows = np.sort(rng.integers(3, size=count))
    across = rng.uniform(0.0, 1.5, (count, 2, 1))
    points = across[:, 0] * edges[(rows + 1) % 3] + across[:, 1] * edges[(rows + 2) % 3]
    return points, normals[rows]


def residuals_of(points: FloatArray, normals: FloatArray, moved: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.einsum("ij,ij->i", moved - points, normals) + NOISE * rng.normal(size=len(points))


@pytest.mark.parametrize("shape", [corner, lambda rng: sphere(rng, 1_500)])
def test_noise_and_motions_are_no_deformation(shape) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, normals = shape(rng)
        moved = pose.apply(twist.exp(0.004 * rng.normal(size=6)), points)
        assert deformation_of(points, normals, residuals_of(points, normals, moved, rng), SIZE) == 0.0


def test_the_scatter_of_what_is_too_small_to_matter_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points, normals = corner(rng)
    said = []
    monkeypatch.setattr("dqreg.trust.robust_fit.scatter_of", lambda *_: said.append(True))
    for shear in (0.0, 1e-5, 0.03):
        moved = points + shear * points[:, [1]] * np.array([1.0, 0.0, 0.0])
        deformation_of(points, normals, residuals_of(points, normals, moved, rng), SIZE)
        assert bool(said) is (shear > 1e-3)


def test_a_shear_is_told_with_what_a_motion_leaves_of_it() -> None:
    rng = np.random.default_rng(0)
    points, normals = corner(rng)
    shear = 0.03 * points[:, [1]] * np.array([1.0, 0.0, 0.0])
    said = deformation_of(points, normals, residuals_of(points, normals, points + shear, rng), SIZE)
    # Oracle: the least-squares remainder of the displacement along the normals, of all motions.
    rows = np.hstack([np.cross(points, normals), normals])
    along = np.einsum("ij,ij->i", shear, normals)
    left = along - rows @ np.linalg.lstsq(rows, along)[0]
    assert said == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.1)


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4])
def test_what_no_face_shows_does_not_hide_a_shear_from_nearly_exact_clouds(noise) -> None:
    """Law: the significance falls as one over the noise. Three faces about a corner leave some strains free."""
    rng = np.random.default_rng(0)
    points, normals = corner(rng)
    along = np.einsum("ij,ij->i", 0.03 * points[:, [1]] * np.array([1.0, 0.0, 0.0]), normals)
    said = [deformation_of(points, normals, along + 1e-3 * rng.normal(size=len(points)), SIZE)]
    said.append(deformation_of(points, normals, along + noise * rng.normal(size=len(points)), SIZE))
    assert said[1] == pytest.approx(said[0], rel=0.02)
    assert deformation_of(points, normals, noise * rng.normal(size=len(points)), SIZE) == 0.0


def test_a_wave_is_told_by_the_quadratic_fields() -> None:
    rng = np.random.default_rng(0)
    points, normals = sphere(rng, 1_500)
    order = np.lexsort(np.round(points * 4.0).T)
    points, normals = points[order], normals[order]
    wave = 0.01 * np.cos(2.5 * points[:, [0]]) * np.array([0.0, 1.0, 0.0])
    assert deformation_of(points, normals, residuals_of(points, normals, points + wave, rng), SIZE) > 5e-4 * SIZE


def test_few_places_show_no_deformation_of_many_numbers() -> None:
    """A wave that 500 places show is none on 400: all that neighbours have in common would look like one."""
    said = []
    for count in (400, 500):
        rng = np.random.default_rng(0)
        points, normals = sphere(rng, count)
        order = np.lexsort(np.round(points * 4.0).T)
        points, normals = points[order], normals[order]
        wave = 0.05 * np.cos(2.5 * points[:, [0]]) * np.array([0.0, 1.0, 0.0])
        said.append(deformation_of(points, normals, residuals_of(points, normals, points + wave, rng), SIZE))
    assert said[0] == 0.0 < said[1]


def test_a_deformation_on_a_part_has_to_show_more_than_one_between_clouds() -> None:
    """Made parts warp a little: a shear that shows 4.7e-4 of the size is told between clouds only."""
    said = []
    for shear in (0.0088, 0.016):
        rng = np.random.default_rng(0)
        points, normals = corner(rng)
        moved = points + shear * points[:, [1]] * np.array([1.0, 0.0, 0.0])
        residuals = np.einsum("ij,ij->i", moved - points, normals) + 1e-4 * rng.normal(size=len(points))
        said.append([deformation_of(points, normals, residuals, SIZE, *limits) for limits in ((), (ON_A_PART,))])
    assert said[0][1] == 0.0 < said[0][0] < 5e-4 * SIZE
    assert said[1][0] == said[1][1] > 5e-4 * SIZE


def test_residuals_that_leave_no_room_for_a_deformation_are_not_asked() -> None:
    """Law: whatever is told on a part has residuals that are asked."""
    rng = np.random.default_rng(0)
    points, normals = corner(rng)
    for shear in np.geomspace(1e-3, 0.1, 8):
        moved = points + shear * points[:, [1]] * np.array([1.0, 0.0, 0.0])
        residuals = residuals_of(points, normals, moved, rng)
        if deformation_of(points, normals, residuals, SIZE, ON_A_PART):
            assert may_be_deformed(float(np.sqrt(np.mean(residuals**2))), NOISE, SIZE)
    assert not may_be_deformed(NOISE, NOISE, SIZE)


@pytest.mark.parametrize("shape", [corner, lambda rng: sphere(rng, 1_500)])
def test_what_a_fit_to_the_end_tells_two_rounds_of_it_do_not_rule_out(shape, monkeypatch: pytest.MonkeyPatch) -> None:
    # Strains and waves about as large as the limits, with strays beside them.
    said = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        points, normals = shape(rng)
        fields = points @ (0.01 * rng.normal(size=(3, 3))), 0.01 * np.square(points) @ rng.normal(size=(3, 3))
        moved = points + 10.0 ** rng.uniform(-1.5, 0.5) * fields[seed % 2]
        residuals = residuals_of(points, normals, moved, rng)
        residuals[rng.random(len(residuals)) < 0.1] += 0.3 * rng.random()
        at_once = deformation_of(points, normals, residuals, SIZE)
        with monkeypatch.context() as patch:
            patch.setattr(deformation, "_may_be_told", lambda *_: True)
            to_the_end = deformation_of(points, normals, residuals, SIZE)
        assert at_once == to_the_end
        said.append(at_once > 0.0)
    assert 10 < sum(said) < 50


@pytest.mark.parametrize("seed", range(5))
def test_what_is_significant_beside_noise_from_point_to_point_is_not_where_neighbours_share_it(seed: int) -> None:
    """A shear of 0.4 % at 8 standard deviations and more: the scatter knows a part of noise that is shared."""
    rng = np.random.default_rng(seed)
    points, normals = corner(rng)
    order = np.lexsort([*np.round(6.0 * points.T), normals[:, 0]])
    points, normals = points[order], normals[order]
    moved = points + 0.004 * points[:, [1]] * np.array([1.0, 0.0, 0.0])
    alone = residuals_of(points, normals, moved, rng)
    shared = alone + NOISE * np.repeat(rng.normal(size=75), 20)
    anyhow, alone_only = (Limits((), (Limit(8.0, 1e-4, 0.0, common),)) for common in (1.0, 0.1))
    said = [
        [deformation_of(points, normals, r, SIZE, limits) > 0.0 for limits in (anyhow, alone_only)]
        for r in (alone, shared)
    ]
    assert said == [[True, True], [True, False]]


def test_a_strain_that_shows_two_thirds_of_the_noise_of_points_is_told() -> None:
    """Views of a part, one of them shorter by 3 % along an axis: at the true pose it had been accepted."""
    task = KINDS["clouds-10-30"].task(52012)
    along = np.array([-0.99, -0.03, 0.14])
    source = task.source - 0.03 * np.outer((task.source - task.source.mean(axis=0)) @ along, along)
    assert "deformed" in register(source, task.target, task.truths[0], search="never").verdict.codes


def test_noise_that_neighbours_share_is_no_deformation() -> None:
    """Views of a part with noise shared by 100 to 500 points: the right pose had been suspect."""
    task = KINDS["clouds-nothing-shared"].task(20800)
    assert register(task.source, task.target, task.truths[0], search="never").verdict.level == "accepted"
