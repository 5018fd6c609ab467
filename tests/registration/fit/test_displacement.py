"""How far apart two poses lay a scan, and a pose is from the initial one."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.registration.fit.displacement import MEANT, MEANT_RAD, displacement_between, is_elsewhere, offset_from_start
from dqreg.registration.fit.fit import Fit
from dqreg.rigid import pose
from tests.icp.scenes import bracket_mesh, bracket_points, motion
from tests.registration.scenes import fit_of, problem_of

PART, POINTS = bracket_mesh(), bracket_points(30, seed=0)
SIZE = PART.diagonal
A, B, C = motion(0.3, 0.1 * SIZE, 1), motion(2.0, 0.4 * SIZE, 2), motion(np.pi, SIZE, 3)


@functools.cache
def fit(unit: float = 1.0) -> Fit:
    part = Mesh(unit * PART.vertices, PART.faces)
    return fit_of(problem_of(unit * POINTS, part, np.eye(4), effort="fast"))


def in_unit(T: FloatArray, unit: float) -> FloatArray:
    T = T.copy()
    T[:3, 3] *= unit
    return T


def test_it_is_a_distance_between_poses() -> None:
    for one in (A, B, C):
        assert displacement_between(fit(), one, one) == 0.0
    for one, other in ((A, B), (B, C), (A, C)):
        there = displacement_between(fit(), one, other)
        assert there == displacement_between(fit(), other, one) > 0.0
    assert displacement_between(fit(), A, C) <= displacement_between(fit(), A, B) + displacement_between(fit(), B, C)


def test_it_is_that_of_the_farthest_point() -> None:
    points = fit().prepared.scan.points
    # Of fewer points than are asked all are; a shift moves each as far.
    apart = np.linalg.norm(pose.apply(A, points) - pose.apply(B, points), axis=1).max()
    assert displacement_between(fit(), A, B) <= apart / SIZE * (1.0 + 1e-9)
    assert displacement_between(fit(), A, B) > 0.9 * apart / SIZE
    shift = pose.from_parts(np.eye(3), [0.0, 0.3 * SIZE, 0.4 * SIZE])
    assert displacement_between(fit(), A, shift @ A) == pytest.approx(0.5)


@pytest.mark.parametrize("frame", [A, B, C])
def test_the_frame_is_no_matter(frame: FloatArray) -> None:
    assert displacement_between(fit(), frame @ A, frame @ B) == pytest.approx(displacement_between(fit(), A, B))


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_is_no_matter(unit: float) -> None:
    one, other = in_unit(A, unit), in_unit(B, unit)
    assert displacement_between(fit(unit), one, other) == pytest.approx(displacement_between(fit(), A, B), rel=1e-6)
    assert offset_from_start(fit(unit), one, other) == pytest.approx(offset_from_start(fit(), A, B), rel=1e-6)


def test_without_an_initial_pose_every_pose_is_meant() -> None:
    assert offset_from_start(fit(), C, None) == 0.0
    assert not is_elsewhere(fit(), C, None)


@pytest.mark.parametrize("share", [0.0, 0.99, 1.01, 3.0])
@pytest.mark.parametrize("what", ["rotation", "shift"])
def test_a_pose_is_elsewhere_beyond_what_a_rough_initial_pose_means(share: float, what: str) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    twist = np.r_[share * MEANT_RAD * axis, np.zeros(3)] if what == "rotation" else np.zeros(6)
    T = pose.exp(twist) if what == "rotation" else pose.from_parts(np.eye(3), share * MEANT * SIZE * axis)
    for one, other in ((T @ A, A), (A, T @ A)):
        # The shift is that of the origin of the frames, which are centred: a rotation about it is none.
        found = offset_from_start(fit(), T, np.eye(4)) if what == "rotation" else offset_from_start(fit(), one, other)
        assert found == pytest.approx(share, abs=1e-6)
        assert is_elsewhere(fit(), T, np.eye(4)) == (share > 1.0)
