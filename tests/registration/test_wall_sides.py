"""A folded sheet without normals: which of its sides the scan shows is told by few points, or by none."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import PointCloud, sample_mesh
from dqreg.registration.wall_sides import _shifts
from dqreg.synth.parts import box
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld

# An angle of 200 by 100 by 40 whose edge at x = 0 is far from the fold.
THICKNESS, NOISE = 0.8, 0.05
_filled = np.array([[[True, False]], [[True, True]]])
_grid = [np.array([0.0, 200.0 - THICKNESS, 200.0]), np.array([0.0, 100.0]), np.array([0.0, THICKNESS, 40.0])]
ANGLE = dqreg.Mesh(*weld(cells(_grid, _filled)))
# The flange on its outer side and the base on its inner one; and both on their outer sides.
FLANGE_OFF, BOTH_OFF = np.array([THICKNESS, 0.0, 0.0]), np.array([THICKNESS, 0.0, -THICKNESS])


def scan_of(*, edge: bool, outer: bool = False, normals: bool = False) -> PointCloud:
    """The inner side, with the edge at x = 0 or without, and with the outer side or without."""
    found = sample_mesh(ANGLE, 30_000, np.random.default_rng(0))
    x, z = found.points[:, 0], found.points[:, 2]
    fold = np.array([200.0 - THICKNESS, THICKNESS])
    seen = (found.normals[:, 2] > 0.5) & (np.abs(z - fold[1]) < 1e-9)
    seen |= (found.normals[:, 0] < -0.5) & (np.abs(x - fold[0]) < 1e-9)
    if edge:
        seen |= np.abs(x) < 1e-9
    if outer:
        seen |= (found.normals[:, 2] < -0.5) | (found.normals[:, 0] > 0.5)
    noise = NOISE * np.random.default_rng(1).normal(size=(np.count_nonzero(seen), 3))
    return PointCloud(found.points[seen] + noise, found.normals[seen] if normals else None)


def shifted(shift: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = shift
    return T


def across(T: np.ndarray) -> float:
    """How far a pose puts some corner off across a leg."""
    moved = ANGLE.vertices @ T[:3, :3].T + T[:3, 3] - ANGLE.vertices
    return float(np.abs(moved[:, [0, 2]]).max())


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.0], FLANGE_OFF, BOTH_OFF, [0.0, 0.0, -THICKNESS]])
def test_a_leg_on_its_wrong_side_is_put_right_where_few_points_tell(shift):
    found = dqreg.register(scan_of(edge=True), ANGLE, shifted(np.asarray(shift)))
    assert across(found.T_target_source) < 0.25 * THICKNESS
    assert not found.alternatives


@pytest.mark.parametrize("shift", [np.zeros(3), FLANGE_OFF, BOTH_OFF])
def test_the_inner_side_alone_may_lie_on_the_outer_one_and_is_not_accepted(shift):
    found = dqreg.register(scan_of(edge=False), ANGLE, shifted(shift))
    assert found.verdict.level != "accepted"
    assert "alternative_poses" in found.verdict.codes
    poses = [found.T_target_source, *(other.T_target_source for other in found.alternatives)]
    for right in (np.zeros(3), BOTH_OFF):
        assert min(across(T @ shifted(-right)) for T in poses) < 0.25 * THICKNESS


@pytest.mark.parametrize("start", ["identity", None])
def test_a_flat_plate_from_one_side_may_lie_on_the_other_and_is_not_accepted(start):
    # Its half-turns are symmetries, which its other side is not, however thin.
    thickness = 0.6
    plate = dqreg.Mesh(*box((100.0, 70.0, thickness)))
    found = sample_mesh(plate, 12_000, np.random.default_rng(0))
    scan = found.points[found.normals[:, 2] > 0.5]
    scan = scan + 0.05 * thickness * np.random.default_rng(1).normal(size=scan.shape)
    result = dqreg.register(scan, plate, start, search="always")
    assert "alternative_poses" in result.verdict.codes
    others = [other for other in result.alternatives if not other.symmetry]
    moved = [T @ np.linalg.inv(result.T_target_source) for T in (other.T_target_source for other in others)]
    assert min(abs(abs(T[2, 3]) - thickness) for T in moved) < 0.25 * thickness


@pytest.mark.parametrize("known", [{"normals": True}, {"outer": True}])
def test_where_normals_or_the_other_side_tell_nothing_else_is_as_likely(known):
    found = dqreg.register(scan_of(edge=False, **known), ANGLE, "identity")
    assert across(found.T_target_source) < 0.25 * THICKNESS
    assert not found.alternatives


def test_a_motion_along_one_wall_leaves_those_that_stay_where_they_are():
    normals, thickness = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 1.2, 0.5])
    shifts = _shifts(normals, thickness)
    moved = shifts @ normals.T
    assert len({tuple(row) for row in (moved < -0.25).tolist()}) == len(shifts) == 7
    np.testing.assert_allclose(np.where(moved < -0.25, moved, 0.0), moved, atol=1e-12)
    np.testing.assert_allclose(np.where(moved < -0.25, -thickness, 0.0), moved, atol=1e-12)
