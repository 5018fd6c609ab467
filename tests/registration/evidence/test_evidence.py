from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud, prepare_scan
from dqreg.icp import Alignment, InlierMixture, find_correspondences
from dqreg.registration.evidence.evidence import agreement_in_time, agreement_of
from dqreg.rigid import pose
from dqreg.trust import Evidence
from dqreg.trust.limits import DISAGREEING_NORMAL_SHARE
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal
SURFACE = MeshSurface(PART)
# Of the virtual scans, along the ray.
NOISE = 3e-4 * SIZE
MAX_DISTANCE = 0.2 * SIZE
POINTS = bracket_points(150, seed=0)


def agreement(
    points: np.ndarray, T: np.ndarray | None = None, width: float = NOISE, asked=agreement_of, **options: bool
) -> Evidence:
    """Agreement at a pose; the scan is made in the part's frame, so the identity is the truth."""
    scan = prepare_scan(PointCloud(points), 2_000)
    pairs = find_correspondences(scan, SURFACE, np.eye(4) if T is None else T)
    mixture = InlierMixture(width, 0.9, MAX_DISTANCE)
    run = Alignment(pairs.T_target_source, "converged", (), pairs, mixture.weight(pairs.distances), mixture=mixture)
    return asked(run, scan, SURFACE, MAX_DISTANCE, **options)


def with_strays(points: np.ndarray, share: float) -> np.ndarray:
    low, high = PART.bounds
    count = round(len(points) * share / (1.0 - share))
    strays = np.random.default_rng(1).uniform(low - 0.3 * SIZE, high + 0.3 * SIZE, (count, 3))
    return np.vstack([points, strays])


def test_the_truth_has_nothing_against_it() -> None:
    found = agreement(POINTS)
    assert found.share_near >= 0.999
    assert found.patches >= 200
    assert found.patches_off == 0.0
    assert found.strays == 0.0
    assert found.normals_apart <= 0.02
    # The distances along the normals are what the neighbourhoods say they should be.
    assert 0.5 * found.expected <= found.width <= 2.0 * found.expected
    assert found.width <= NOISE


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_strays_are_counted_and_move_few_patches(share: float) -> None:
    found = agreement(with_strays(POINTS, share))
    assert found.strays == pytest.approx(share, abs=0.06)
    assert found.patches_off <= 0.1
    # Strays near the part may hide among its points; hardly one in ten does.
    assert found.share_near >= 1.0 - share


def test_waves_over_the_whole_scan_are_told_whatever_width_they_make() -> None:
    # As of a robot that shakes while it scans: 0.3 % of the size. The fit takes them for noise.
    waves = 3e-3 * SIZE * np.sin(16.0 * np.pi / SIZE * POINTS @ [0.6, -0.5, 0.6])[:, None] * [0.6, 0.6, 0.53]
    found, still = agreement(POINTS + waves, width=2e-3 * SIZE), agreement(POINTS, width=2e-3 * SIZE)
    assert found.patches_off == 0.0
    # Their root mean square along one of the axes, about.
    assert found.waviness == pytest.approx(0.58 * 3e-3 * SIZE / np.sqrt(2.0), rel=0.2)
    assert still.waviness == 0.0


def test_a_feature_of_another_revision_is_told_apart_from_outliers() -> None:
    # All points in a ball of a twelfth of the size are moved by 2 % of it, outwards.
    middle = POINTS[np.argmax(POINTS[:, 0])]
    moved = np.linalg.norm(POINTS - middle, axis=1) < SIZE / 12.0
    found = agreement(POINTS + np.where(moved, 0.02 * SIZE, 0.0)[:, None] * [1.0, 0.0, 0.0])
    # Faces along the motion stay on the part, and runs end where it begins.
    assert 0.3 * np.mean(moved) <= found.share_together <= 1.05 * np.mean(moved)
    assert agreement(with_strays(POINTS, 0.3)).share_together <= 2e-3
    assert agreement(POINTS).share_together == 0.0


def test_a_table_is_no_stray() -> None:
    low, high = PART.bounds
    rng = np.random.default_rng(2)
    around = rng.uniform(low[:2] - SIZE, high[:2] + SIZE, (len(POINTS), 2))
    sheet = np.column_stack([around, np.full(len(POINTS), low[2])])
    sheet[:, 2] += 0.3 * NOISE * rng.normal(size=len(sheet)) - 0.06 * SIZE
    found = agreement(np.vstack([POINTS, sheet]))
    assert found.strays <= 0.05
    # It stands farther off than a point of the part could: it has no say about the patches.
    assert found.patches_off <= 0.03


def test_a_shifted_pose_moves_whole_patches() -> None:
    found = agreement(POINTS, pose.from_parts(np.eye(3), [0.0, 0.0, 10.0 * NOISE]))
    assert found.patches_off >= 0.2


def test_a_turned_pose_has_other_normals_where_faces_cross() -> None:
    tilt = pose.from_parts(np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]), np.zeros(3))
    tilted = pose.about(tilt, PART.centre)
    assert agreement(POINTS, tilted).patches_off >= 0.3
    # At a width that calls nearly everything an inlier, the normals still tell.
    wide = agreement(POINTS, tilted, width=0.03 * SIZE)
    assert wide.patches_off <= 0.02
    # A neighbourhood whose closest points lie on one face shows it; those near edges need not.
    assert wide.normals_apart >= 3.0 * DISAGREEING_NORMAL_SHARE


def test_points_beside_a_target_with_a_border_say_nothing() -> None:
    # A plate in z = 0, and a scan of a larger one: beyond its border points are off, but not aside.
    plate = Mesh([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], [[0, 1, 2], [0, 2, 3]])
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 12, (5_000, 2)), 1e-3 * rng.normal(size=5_000)])
    surface, scan = MeshSurface(plate), prepare_scan(PointCloud(points))
    pairs = find_correspondences(scan, surface, np.eye(4))
    mixture = InlierMixture(1e-3, 0.9, 4.0)
    run = Alignment(np.eye(4), "converged", (), pairs, mixture.weight(pairs.distances), mixture=mixture)
    closed, open_ = (agreement_of(run, scan, surface, 40.0, has_border=border) for border in (False, True))
    assert closed.patches_off >= 0.2
    assert open_.patches_off <= 0.02
    assert open_.share_near >= 0.99


@pytest.mark.parametrize("has_border", [False, True])
@pytest.mark.parametrize("off", [0.0, 2.0])
def test_what_is_asked_where_the_time_is_up_says_how_many_are_inliers_and_how_far_off(
    off: float, has_border: bool
) -> None:
    # Off by so many standard deviations of the noise along each axis. A tenth of the points is looked at.
    at = pose.from_parts(np.eye(3), np.full(3, off * NOISE))
    late, whole = (agreement(POINTS, at, asked=a, has_border=has_border) for a in (agreement_in_time, agreement_of))
    assert late.inliers == whole.inliers
    assert late.share_near == pytest.approx(whole.share_near, abs=0.05)
    assert late.share_on == pytest.approx(whole.share_on, abs=0.05)
    assert late.width == pytest.approx(whole.width, rel=0.1)
    assert late.has_border is has_border
    assert late.near == whole.near


def test_lengths_follow_the_unit_and_shares_do_not() -> None:
    plain = agreement(POINTS)
    scan = prepare_scan(PointCloud(1e3 * POINTS), 2_000)
    surface = MeshSurface(dataclasses.replace(PART, vertices=1e3 * PART.vertices))
    pairs = find_correspondences(scan, surface, np.eye(4))
    mixture = InlierMixture(1e3 * NOISE, 0.9, 1e3 * MAX_DISTANCE)
    run = Alignment(np.eye(4), "converged", (), pairs, mixture.weight(pairs.distances), mixture=mixture)
    scaled = agreement_of(run, scan, surface, 1e3 * MAX_DISTANCE)
    for name in ("share_near", "patches", "patches_off", "strays", "normals_apart"):
        assert getattr(scaled, name) == pytest.approx(getattr(plain, name), abs=1e-3)
    for name in ("width", "expected", "near"):
        assert getattr(scaled, name) == pytest.approx(1e3 * getattr(plain, name), rel=1e-6)


def test_points_beyond_the_border_of_a_cloud_speak_neither_for_a_pose_nor_against_it() -> None:
    # Two views of one block: the target shows two faces, the scan those and a third behind their edge. The truth is the
    # identity.
    x, y = (side.ravel() for side in np.meshgrid(np.arange(0.0, 40.0), np.arange(0.0, 40.0)))
    top, front = np.column_stack([x, y, 0.0 * x]), np.column_stack([x, 0.0 * x, -1.0 - y])
    behind = np.column_stack([-1.0 + 0.0 * x, x, -1.0 - y])
    surface, scan = (
        CloudSurface(PointCloud(np.vstack([top, front]))),
        prepare_scan(PointCloud(np.vstack([top, behind]))),
    )
    mixture = InlierMixture(0.5, 0.9, 40.0)

    def at(T: np.ndarray) -> Evidence:
        pairs = find_correspondences(scan, surface, T)
        run = Alignment(T, "converged", (), pairs, mixture.weight(pairs.distances), mixture=mixture)
        return agreement_of(run, scan, surface, 40.0, has_border=True)

    right, sunk = at(np.eye(4)), at(pose.from_parts(np.eye(3), [0.0, 0.0, -6.0]))
    assert right.share_near >= 0.9
    assert right.patches_off <= 0.02
    # Six spacings off, the middle of the top face is seen to be off.
    assert sunk.patches_off >= 0.5
