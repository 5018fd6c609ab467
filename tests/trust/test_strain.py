from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqreg.geometry.morton import distinct_in_order
from dqreg.trust import strain
from dqreg.trust.strain import FIRST_POINTS, MIN_CORRESPONDENCES, MIN_STRAIN, STRAIN_SIGMAS, Strain, strain_of
from tests.strategies import FloatArray
from tests.trust.shapes import box, cylinder, plane, sphere

NOISE = 0.003


def scanned(make, count: int = 2_000, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of a shape of extent 3 in order, normals, and independent noise of a thousandth of that."""
    rng = np.random.default_rng(seed)
    points, normals = make(rng, count)
    order = distinct_in_order(points)
    return points[order], normals[order], NOISE * rng.normal(size=len(order))


def strained(E: FloatArray, make=box, seed: int = 0, *, clutter: bool = False) -> Strain:
    points, normals, noise = scanned(make, seed=seed)
    return strain_of(points, normals, np.einsum("ij,ij->i", points @ E.T, normals) + noise, clutter=clutter)


@pytest.mark.parametrize("value", [-0.1, -0.01, 0.01, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_a_stretch_along_any_axis_is_found_within_its_sigma(value: float, seed: int) -> None:
    # To first order the residual of a point is its displacement along the normal, as the fit has it.
    axis = np.eye(3)[seed]
    found = strained(value * np.outer(axis, axis), seed=seed)
    assert found.is_strained
    assert abs(found.value - value) <= 4.0 * found.sigma + 0.01 * abs(value)
    assert abs(np.array(found.along) @ axis) > 0.99
    assert not found.is_bent


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("value", [0.0, 0.02])
def test_strays_beside_two_faces_are_no_strain_and_hide_none(value: float, seed: int) -> None:
    """Half the points above two opposite faces stand up to a tenth of the extent off: together they look longer."""
    points, normals, residuals = scanned(box, seed=seed)
    rng = np.random.default_rng(100 + seed)
    off = (rng.random(len(points)) < 0.5) & (np.abs(normals[:, 2]) > 0.9)
    residuals = residuals + value * points[:, 0] * normals[:, 0] ** 2 * np.sign(normals[:, 0])
    found = strain_of(points, normals, np.where(off, rng.uniform(0.0, 0.3, len(points)), residuals), strays=True)
    assert found.is_strained == (value > 0.0)
    if value:
        assert found.value == pytest.approx(value, rel=0.05)
        assert abs(found.along[0]) > 0.99


@pytest.mark.parametrize("make", [box, sphere])
def test_a_scale_has_no_axis(make) -> None:
    found = strained(0.01 * np.eye(3), make)
    assert found.is_strained
    assert found.value == pytest.approx(0.01, abs=4.0 * found.sigma)
    assert found.along == (0.0, 0.0, 0.0)


def test_a_shear_is_two_strains_of_equal_size() -> None:
    E = np.zeros((3, 3))
    E[0, 1] = E[1, 0] = 0.01
    found = strained(E)
    assert abs(found.value) == pytest.approx(0.01, abs=1e-3)
    assert np.abs(found.along)[:2] == pytest.approx([0.5**0.5] * 2, abs=0.05)


def test_a_bend_is_found_and_is_no_stretch() -> None:
    points, normals, noise = scanned(box)
    # A beam of length 3 with a sagitta of 0.5 %: its sections turn with the axis.
    curvature = 8.0 * 0.005 / 3.0
    moved = np.zeros_like(points)
    moved[:, 2] = 0.5 * curvature * points[:, 0] ** 2
    moved[:, 0] = -curvature * points[:, 0] * points[:, 2]
    found = strain_of(points, normals, np.einsum("ij,ij->i", moved, normals) + noise)
    assert found.is_bent
    assert found.bend == pytest.approx(0.005, abs=5e-4)
    assert not found.is_strained


def test_a_torsion_is_found_and_is_no_stretch() -> None:
    points, normals, noise = scanned(box)
    # A beam of length 3 whose ends are turned by 2 degrees against each other.
    turn = np.deg2rad(2.0) / 3.0 * points[:, 0]
    moved = np.column_stack([np.zeros_like(turn), -turn * points[:, 2], turn * points[:, 1]])
    found = strain_of(points, normals, np.einsum("ij,ij->i", moved, normals) + noise)
    assert found.is_bent
    # Half of the angle at the rms distance of the faces of 2 x 1 from the axis, 0.80, over the length.
    assert found.bend == pytest.approx(np.deg2rad(1.0) * 0.80 / 3.0, rel=0.1)
    assert not found.is_strained


@pytest.mark.parametrize("make", [box, cylinder, plane, sphere])
def test_noise_and_the_rest_of_a_motion_are_no_strain(make) -> None:
    for seed in range(10):
        points, normals, noise = scanned(make, 1_000, seed)
        turn = Rotation.from_rotvec([0.01, -0.02, 0.01]).as_matrix() - np.eye(3)
        found = strain_of(points, normals, np.einsum("ij,ij->i", points @ turn.T + 0.02, normals) + 3.0 * noise)
        assert not found.is_strained
        assert not found.is_bent


def test_few_points_and_what_the_faces_do_not_show_are_nothing() -> None:
    points, normals, _ = scanned(box)
    few = slice(0, MIN_CORRESPONDENCES - 1)
    assert strain_of(points[few], normals[few], points[few, 0]) == Strain()
    assert not strained(0.05 * np.diag([1.0, 1.0, 0.0]), plane).is_strained
    assert not strained(0.8 * MIN_STRAIN * np.diag([1.0, 0.0, 0.0])).is_strained


@pytest.mark.parametrize("make", [box, cylinder, plane, sphere])
def test_exact_points_are_no_strain(make) -> None:
    points, normals, _ = scanned(make)
    assert not strain_of(points, normals, np.zeros(len(points))).is_strained


def test_one_sided_clutter_is_no_length() -> None:
    points, normals, residuals = scanned(box)
    # A tenth of the points is of something that leans against one side.
    beside = (normals[:, 0] > 0.9) & (points[:, 1] > 0.3)
    residuals[beside] += 0.1
    assert not strain_of(points, normals, residuals, clutter=True).is_strained


@pytest.mark.parametrize("share", [0.5, 0.8, 1.3, 5.0])
def test_of_faults_alone_what_is_too_small_for_one_is_none_and_the_others_are_as_they_are(share: float) -> None:
    points, normals, noise = scanned(box)
    residuals = share * MIN_STRAIN * points[:, 0] * normals[:, 0] + 0.03 * noise
    found, fault = strain_of(points, normals, residuals), strain_of(points, normals, residuals, faults=True)
    assert found.is_strained == (share > 1.0)
    assert any(found.along)
    assert fault == (found if share > 1.0 else Strain())


@pytest.mark.parametrize("value", [0.0, 0.004, 0.008, 0.02])
def test_strains_that_show_less_than_what_is_asked_for_are_none_and_the_others_are_as_they_are(value: float) -> None:
    points, normals, noise = scanned(box)
    residuals = value * points[:, 0] * normals[:, 0] + noise
    found, least = strain_of(points, normals, residuals), 0.006
    asked = strain_of(points, normals, residuals, least=least)
    assert asked == (found if found.shown >= least else Strain())
    assert (asked == Strain()) == (value < 0.005)


@pytest.mark.parametrize("far", [0.05, 0.1])
def test_what_a_few_points_draw_and_brings_the_others_no_nearer_is_none_where_that_is_asked(far: float) -> None:
    points, normals, noise = scanned(box)
    off = noise + far * ((normals[:, 0] > 0.9) & (points[:, 1] > 0.3))
    assert strain_of(points, normals, off).is_strained
    assert strain_of(points, normals, off, nearer=0.9) == Strain()


@pytest.mark.parametrize("times", [1.0, 10.0])
def test_a_strain_that_all_points_show_is_the_same_where_that_is_asked(times: float) -> None:
    points, normals, noise = scanned(box)
    # Amid ten times the noise the usual point is hardly nearer.
    stretched = 0.01 * points[:, 0] * normals[:, 0] + times * noise
    found, asked = strain_of(points, normals, stretched), strain_of(points, normals, stretched, nearer=0.9)
    assert found.is_strained
    assert asked.is_strained
    assert asked.value == pytest.approx(found.value, abs=0.1 * found.sigma)


def test_of_many_points_some_tell_that_there_is_no_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    fit = strain.robust_fit
    monkeypatch.setattr(strain, "robust_fit", lambda rows, *a, **k: asked.append(rows.shape[1]) or fit(rows, *a, **k))
    points, normals, noise = scanned(box, 3 * FIRST_POINTS)
    assert strain_of(points, normals, 0.1 * noise) == Strain()
    assert asked == [FIRST_POINTS]


@pytest.mark.parametrize("seed", range(20))
def test_a_strain_that_all_points_just_show_is_hidden_by_no_choice_of_them(seed: int) -> None:
    points, normals, noise = scanned(box, 3 * FIRST_POINTS, seed)
    stretched = 1.2 * MIN_STRAIN * points[:, 0] * normals[:, 0]
    # As noisy as a significant strain of that size may be.
    sigma = strain_of(points, normals, 10.0 * stretched + noise).sigma
    found = strain_of(points, normals, stretched + noise * 1.2 * MIN_STRAIN / (STRAIN_SIGMAS * sigma))
    assert found.value == pytest.approx(1.2 * MIN_STRAIN, abs=4.0 * min(found.sigma, MIN_STRAIN))
    assert found != Strain()
