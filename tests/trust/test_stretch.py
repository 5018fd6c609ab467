from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.trust.patch_tests import LEAST, stretch_of
from tests.strategies import FloatArray, rotations
from tests.trust.shapes import box, cylinder, plane, sphere


def moved_apart(points: FloatArray, normals: FloatArray, E: FloatArray) -> FloatArray:
    """Distances along the normals after a strain: exact to first order, as the fit has it."""
    return np.einsum("ij,ij->i", points @ E.T, normals)


@settings(deadline=None, max_examples=25)
@given(rotations(), st.sampled_from([-0.3, -0.05, 0.03, 0.2]), st.sampled_from([1e-6, 1.0, 1e6]), st.integers(0, 2))
def test_a_strain_along_any_axis_is_found_in_any_unit(R: FloatArray, strain: float, unit: float, axis: int) -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng, 2_000)
    points, normals = points @ R.T, normals @ R.T
    along = R[:, axis]
    # A turn and a shift besides: what the pose has yet to take up is no strain.
    rigid = np.einsum("ij,ij->i", np.cross([0.01, -0.02, 0.01], points) + np.array([0.1, 0.0, -0.2]), normals)
    off = moved_apart(points, normals, strain * np.outer(along, along)) + rigid + 0.005 * rng.normal(size=2_000)
    found, axis_found = stretch_of(unit * points + unit * np.array([5.0, 0.0, 0.0]), normals, unit * off)
    assert found == pytest.approx(strain, abs=0.003)
    assert abs(axis_found @ along) > 0.99
    assert axis_found[np.abs(axis_found).argmax()] > 0.0


@pytest.mark.parametrize("make", [box, cylinder, plane, sphere])
def test_noise_is_no_strain(make) -> None:
    # 60 draws of each: chance reaches the limit once in a million.
    for seed in range(60):
        rng = np.random.default_rng(seed)
        points, normals = make(rng, 400)
        assert stretch_of(points, normals, 0.1 * rng.normal(size=400))[0] == 0.0


@pytest.mark.parametrize("count", [40, 60, 100])
def test_few_points_tell_a_strain_that_is_larger_than_their_noise_and_no_noise(count: int) -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points, normals = box(rng, count)
        noise = 2e-3 * rng.normal(size=count)
        found = stretch_of(points, normals, moved_apart(points, normals, np.diag([0.05, 0.0, 0.0])) + noise)[0]
        # All six strains are free: the faces of a box know each to about noise over extent and root of the points.
        assert found == pytest.approx(0.05, abs=0.01)
        assert stretch_of(points, normals, noise)[0] == 0.0


def test_a_small_strain_is_left_to_the_deviations() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng, 2_000)
    E = np.diag([0.9 * LEAST, 0.0, 0.0])
    assert stretch_of(points, normals, moved_apart(points, normals, E) + 1e-4 * rng.normal(size=2_000))[0] == 0.0


def test_a_strain_that_displaces_the_surface_by_less_than_a_length_is_none() -> None:
    # A wide face, and twenty points at two ends across it: these alone show the strain.
    rng = np.random.default_rng(0)
    points, normals = plane(rng, 1_000)
    across = np.array([1.0, 0.0, 0.0])
    ends = np.concatenate([np.c_[np.full(10, x), rng.uniform(-1.0, 1.0, (10, 2))] for x in (-1.0, 1.0)])
    points, normals = np.concatenate([points, ends]), np.concatenate([normals, np.tile(across, (20, 1))])
    off = moved_apart(points, normals, np.diag([0.05, 0.0, 0.0])) + 1e-4 * rng.normal(size=len(points))
    shown = 0.05 * np.sqrt(20.0 / len(points))
    assert stretch_of(points, normals, off, 0.8 * shown)[0] == pytest.approx(0.05, abs=0.003)
    assert stretch_of(points, normals, off, 1.2 * shown)[0] == 0.0


def test_what_the_faces_do_not_show_is_not_made_up() -> None:
    # A plane stretched in itself stays a plane; few points and points at one place say nothing.
    points, normals = plane(np.random.default_rng(0), 1_000)
    assert stretch_of(points, normals, np.zeros(1_000))[0] == 0.0
    assert stretch_of(points[:35], normals[:35], points[:35, 0])[0] == 0.0
    assert stretch_of(np.ones((500, 3)), normals[:500], np.ones(500))[0] == 0.0
