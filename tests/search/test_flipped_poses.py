from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import smallest_kernel_scale
from dqreg.rigid import pose
from dqreg.search import flipped_poses as module
from dqreg.search.flipped_poses import (
    FIRST_REFINEMENT,
    _not_clearly_worse,
    _refined,
    _told_apart,
    flipped_poses,
    gain_of_mirror,
)
from dqreg.search.near_symmetry import near_flips, near_mirrors
from dqreg.search.poses import Poses
from dqreg.search.scoring import distances_at
from dqreg.synth.parts import block, bracket
from dqreg.trust.limits import MIRROR_GAIN

# Half a turn about an axis leaves this block in place but for one small feature.
BLOCK = Mesh(*block())
SURFACE = MeshSurface(BLOCK)
FLIPS = near_flips(BLOCK, SURFACE)
NOISE = 2e-4 * BLOCK.diagonal
PART = Mesh(*bracket())
PART_SURFACE = MeshSurface(PART)
TWIN = Mesh(PART.vertices * [-1.0, 1.0, 1.0], PART.faces[:, ::-1])


def scan_of(points: np.ndarray):
    rng = np.random.default_rng(0)
    return prepare_scan(PointCloud(points + NOISE * rng.normal(size=points.shape)), 2_000)


def others(T: np.ndarray, scan) -> list:
    return flipped_poses(T, FLIPS, scan, SURFACE, 0.05 * BLOCK.diagonal, smallest_kernel_scale(scan, SURFACE))


def test_the_small_feature_decides_for_the_truth() -> None:
    # The scan is made in the part's frame: the truth is the identity.
    scan = scan_of(sample_mesh(BLOCK, 30_000, np.random.default_rng(1)).points)
    assert others(np.eye(4), scan) == []


def test_known_distances_compare_as_well_as_distances_that_are_found() -> None:
    scan = scan_of(sample_mesh(BLOCK, 5_000, np.random.default_rng(1)).points)
    asked = scan.points, SURFACE.closest(scan.points).distances
    floor = smallest_kernel_scale(scan, SURFACE)
    given = np.eye(4), FLIPS, scan, SURFACE, 0.05 * BLOCK.diagonal, floor, FIRST_REFINEMENT
    (one, found), (other, known) = _refined(*given), _refined(*given, asked=asked)
    np.testing.assert_array_equal(one.matrices, other.matrices)
    np.testing.assert_array_equal(found.likelihoods, known.likelihoods)


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


def test_few_points_drop_no_flip_that_is_equally_likely() -> None:
    # What lies on the part in either pose, with other noise each time. Of 200 seeds none came nearer to being dropped
    # than one standard error beyond what is allowed; the limit is 2.5.
    points = sample_mesh(BLOCK, 8_000, np.random.default_rng(1)).points
    points = points[SURFACE.closest(pose.apply(FLIPS[0], points)).distances <= 1e-6 * BLOCK.diagonal]
    for seed in range(16):
        noisy = points + NOISE * np.random.default_rng(seed).normal(size=points.shape)
        scan = prepare_scan(PointCloud(noisy), 100)
        lengths = 0.05 * BLOCK.diagonal, 0.3 * NOISE
        scores = _refined(np.eye(4), FLIPS[:1], scan, SURFACE, *lengths, FIRST_REFINEMENT)[1]
        assert len(_not_clearly_worse(scores, 0)) == 1


def test_points_that_are_asked_drop_a_flip_where_twice_as_many_see_the_feature_as_tell_poses_apart() -> None:
    points = sample_mesh(BLOCK, 40_000, np.random.default_rng(1)).points
    apart = SURFACE.closest(pose.apply(FLIPS[0], points)).distances
    same, feature = points[apart <= 1e-6 * BLOCK.diagonal][:1_000], points[np.argsort(-apart)]
    assert [told(np.concatenate([same, feature[:count]])) for count in (0, 4, 5, 8, 30)] == [False] * 3 + [True] * 2


@pytest.mark.parametrize(("clear", "counts"), [(True, [1_000]), (False, [5_000])])
def test_what_a_fifth_of_the_points_said_before_it_says_again(
    monkeypatch: pytest.MonkeyPatch, clear: bool, counts: list[int]
) -> None:
    asked: list[int] = []

    def counting(poses: Poses, some: np.ndarray, *others: Any) -> np.ndarray:
        asked.append(len(some))
        return distances_at(poses, some, *others)

    monkeypatch.setattr(module, "distances_at", counting)
    assert told(sample_mesh(BLOCK, 40_000, np.random.default_rng(1)).points[:5_000], clear=clear)
    assert asked == counts


def told(points: np.ndarray, *, clear: bool = False) -> bool:
    """Whether points tell the first flip for sure from the truth, which few points may have told clearly before."""
    scan, limit = scan_of(points), 0.05 * BLOCK.diagonal
    poses, scores = _refined(np.eye(4), FLIPS[:1], scan, SURFACE, limit, 0.3 * NOISE, FIRST_REFINEMENT)
    asked = scan.points, SURFACE.closest(scan.points).distances
    return bool(_told_apart(poses[np.array([1])], np.array([clear]), scores.width, SURFACE, limit, *asked)[0])


def test_points_that_are_asked_drop_nothing_that_would_be_named() -> None:
    for seed in range(4):
        scan = scan_of(sample_mesh(BLOCK, 6_000, np.random.default_rng(seed)).points)
        asked = scan.points, SURFACE.closest(pose.apply(FLIPS[0], scan.points)).distances
        lengths = 0.05 * BLOCK.diagonal, smallest_kernel_scale(scan, SURFACE)
        # From the wrong pose, the right one stays.
        found = flipped_poses(FLIPS[0], FLIPS, scan, SURFACE, *lengths, asked)
        assert [T.tolist() for T, _ in found] == [T.tolist() for T, _ in others(FLIPS[0], scan)]
        assert found


def test_no_flips_cost_nothing() -> None:
    scan = scan_of(sample_mesh(BLOCK, 3_000, np.random.default_rng(1)).points)
    assert flipped_poses(np.eye(4), FLIPS[:0], scan, SURFACE, 1.0, 1e-3) == []


def gain(mesh: Mesh, seed: int) -> float:
    # Truth: the samples lie on the part or on its twin, which the first mirror brings nearest to the part; noise of
    # 3e-4 sizes, and a pose that is off by as much as a registration may be.
    rng = np.random.default_rng(seed)
    points = sample_mesh(mesh, 6_000, rng).points
    if mesh is TWIN:
        flip = near_mirrors(PART, PART_SURFACE)[0] @ np.diag([-1.0, 1.0, 1.0, 1.0])
        points = pose.apply(flip, points)
    scan = prepare_scan(PointCloud(points + 3e-4 * PART.diagonal * rng.normal(size=points.shape)))
    T = pose.from_parts(np.eye(3), 1e-4 * PART.diagonal * rng.normal(size=3))
    return gain_of_mirror(
        T,
        near_mirrors(PART, PART_SURFACE),
        scan,
        PART_SURFACE,
        0.05 * PART.diagonal,
        smallest_kernel_scale(scan, PART_SURFACE),
    )


def test_without_a_mirror_nothing_is_gained():
    scan = prepare_scan(PointCloud(sample_mesh(PART, 1_000, np.random.default_rng(0)).points))
    assert gain_of_mirror(np.eye(4), np.zeros((0, 4, 4)), scan, PART_SURFACE, 1.0, 1e-3) == -np.inf


@pytest.mark.parametrize("seed", range(3))
def test_the_twin_gains_in_the_mirror_and_the_part_loses(seed):
    # A tenth of the bracket's surface is the difference: far from the limit on either side.
    assert gain(TWIN, seed) > 10.0 * MIRROR_GAIN
    assert gain(PART, seed) < -10.0 * MIRROR_GAIN
