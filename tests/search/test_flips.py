from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import width_floor
from dqreg.rigid import pose
from dqreg.search.flips import flipped, near_flips
from dqreg.synth.parts import block, box, bracket

# Half a turn about an axis leaves this block in place but for one small feature.
BLOCK = Mesh(*block())
SURFACE = MeshSurface(BLOCK)
FLIPS = near_flips(BLOCK, SURFACE)
NOISE = 2e-4 * BLOCK.diagonal


def scan_of(points: np.ndarray):
    rng = np.random.default_rng(0)
    return prepare_scan(PointCloud(points + NOISE * rng.normal(size=points.shape)), 2_000)


def others(T: np.ndarray, scan) -> list:
    return flipped(T, FLIPS, scan, SURFACE, 0.05 * BLOCK.diagonal, width_floor(scan, SURFACE))


def test_a_nearly_symmetric_block_has_flips() -> None:
    assert 1 <= len(FLIPS) <= 23
    # They are proper motions, and none is the identity.
    for T in FLIPS:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0, abs=1e-12)
        assert pose.angle_between(T, np.eye(4)) > 1.0


@pytest.mark.parametrize("part", [box((3.0, 2.0, 1.0)), bracket()], ids=["symmetric", "plain"])
def test_a_symmetry_is_no_flip_and_neither_is_what_moves_the_part(part: tuple) -> None:
    mesh = Mesh(*part)
    assert len(near_flips(mesh, MeshSurface(mesh))) == 0


def test_the_small_feature_decides_for_the_truth() -> None:
    # The scan is made in the part's frame: the truth is the identity.
    scan = scan_of(sample_mesh(BLOCK, 30_000, np.random.default_rng(1)).points)
    assert others(np.eye(4), scan) == []


def test_from_a_flip_the_truth_is_found_as_the_better_one() -> None:
    scan = scan_of(sample_mesh(BLOCK, 30_000, np.random.default_rng(1)).points)
    wrong = FLIPS[0]
    found = others(wrong, scan)
    assert found
    # To the noise of a thousand points that refine it.
    assert min(pose.offset_between(T, np.eye(4), at=BLOCK.centre) for T, _ in found) <= 1e-3 * BLOCK.diagonal
    assert min(pose.angle_between(T, np.eye(4)) for T, _ in found) <= 2e-3


def test_a_scan_that_does_not_see_the_feature_leaves_both_poses() -> None:
    points = sample_mesh(BLOCK, 60_000, np.random.default_rng(1)).points
    # What lies on the part in either pose cannot tell them apart.
    same = SURFACE.closest(pose.apply(FLIPS[0], points)).distances <= 1e-6 * BLOCK.diagonal
    found = others(np.eye(4), scan_of(points[same]))
    assert found
    assert min(pose.angle_between(T, FLIPS[0]) for T, _ in found) <= 1e-2


def test_no_flips_cost_nothing() -> None:
    scan = scan_of(sample_mesh(BLOCK, 3_000, np.random.default_rng(1)).points)
    assert flipped(np.eye(4), FLIPS[:0], scan, SURFACE, 1.0, 1e-3) == []
