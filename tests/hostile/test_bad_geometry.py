"""Geometry that is broken in known ways, through the front door: what is dropped, said, and left unknown."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest

from dqreg.geometry import Mesh, PointCloud
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose, twist
from tests.hostile.scenes import PART, SCAN, SIZE, START, part

# The scan was made in the part's frame: the truth is the identity, to the noise of 470 points.
NEAR = 2e-3 * SIZE


@cache
def plain() -> Registration:
    return register(SCAN, part(), START, effort="fast")


def off(result: Registration) -> float:
    """Largest distance between a vertex and where the pose has it."""
    return float(np.abs(result.apply(PART.vertices) - PART.vertices).max())


def true_normals() -> np.ndarray:
    return part().indexed.surface.closest(SCAN).normals


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_points_whose_normal_is_none_are_dropped_and_counted(bad: float) -> None:
    normals = true_normals().copy()
    normals[::20] = bad
    result = register(PointCloud(SCAN, normals), part(), START, effort="fast")
    assert result.settings["source_dropped"] == len(normals[::20])
    assert result.verdict.level == "accepted"
    assert off(result) < NEAR


def test_copies_of_a_point_vote_once() -> None:
    # A thousand copies of one point would hold the pose there, and its covariance would shrink by them.
    copies = np.vstack([SCAN, np.repeat(SCAN[:1], 1_000, axis=0)])
    result = register(copies, part(), START, effort="fast")
    np.testing.assert_allclose(result.T_target_source, plain().T_target_source, atol=1e-9 * SIZE)
    np.testing.assert_allclose(result.covariance, plain().covariance, rtol=1e-6)


@pytest.mark.parametrize("fault", ["flipped", "flat", "open"])
def test_a_mesh_with_faults_registers_and_says_what_is_wrong_with_it(fault: str) -> None:
    faces = PART.faces.copy()
    if fault == "flipped":
        faces[::3] = faces[::3, ::-1]
    elif fault == "flat":
        faces = np.vstack([faces, [[0, 0, 1], [2, 2, 2]]])
    else:
        faces = faces[3:]
    mesh = Mesh(PART.vertices, faces)
    words = {"flipped": "against each other", "flat": "no area", "open": "not watertight"}[fault]
    assert any(words in sentence for sentence in mesh.faults)
    result = register(SCAN, mesh, START, effort="fast")
    assert result.settings["target_dropped"] == (2 if fault == "flat" else 0)
    assert off(result) < NEAR
    if fault == "flat":
        assert result.deviations().signed
        return
    # Which side is out cannot be told: distances only, and a warning that says why.
    with pytest.warns(UserWarning, match="no sign"):
        found = result.deviations()
    assert not found.signed
    assert (found.values >= 0.0).all()


def test_a_sound_mesh_has_signs_and_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = plain().deviations()
    assert found.signed
    assert found.values.min() < 0.0 < found.values.max()


def test_the_covariance_of_a_plane_is_nan_where_the_plane_slides() -> None:
    # The top of a plate: it slides along x and y and spins about z; free means unknown, never small.
    plate = Mesh([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-3, 3, (3_000, 2)), 1e-3 * rng.normal(size=3_000)])
    T_start = pose.from_parts(np.eye(3), [0.2, -0.1, 0.05])
    result = register(points, plate, T_start, effort="fast")
    assert result.verdict.level == "suspect"
    assert np.isnan(np.diag(result.covariance)).tolist() == [False, False, True, True, True, False]
    assert np.isfinite(result.T_target_source).all()
    # What nothing holds is where the start had it.
    np.testing.assert_allclose(twist.log(result.T_target_source)[[2, 3, 4]], [0.0, 0.2, -0.1], atol=1e-6)
