from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import Mesh, MeshSurface, PointCloud, Scan, prepare_scan
from dqreg.geometry.scan_measures import CLOUD_PARTS
from dqreg.icp import Correspondences, find_correspondences, points_to_planes
from dqreg.icp.full_resolution import gather, run_centres
from dqreg.rigid import pose
from dqreg.synth import disturbance, worst_vertex_displacement
from dqreg.synth.parts import box
from dqreg.trust import information_of
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal
SURFACE = MeshSurface(PART)
# Of the virtual scans, along the ray.
NOISE = 3e-4 * SIZE


@pytest.fixture(scope="module")
def scan() -> Scan:
    return prepare_scan(PointCloud(bracket_points(300, seed=0)), fitted=2_000)


def gathered(
    scan: Scan, surface: MeshSurface, T: np.ndarray, runs: int, count: int, width: float = NOISE
) -> Correspondences:
    middles = find_correspondences(scan.taken(run_centres(len(scan), runs)[0]), surface, T)
    return gather(scan, surface, middles, np.ones(len(middles.scan)), T, width, count)


@given(st.integers(1, 5_000), st.integers(1, 5_000))
@settings(deadline=None, max_examples=100)
def test_runs_are_of_one_length_and_leave_less_than_one_over(total: int, runs: int) -> None:
    rows, length = run_centres(total, runs)
    assert len(rows) <= runs
    assert 0 <= total - length * len(rows) < length
    assert (rows // length == np.arange(len(rows))).all()


@pytest.mark.parametrize("runs", [500, 2_000, 10_000])
def test_all_points_are_there_at_their_exact_distances(scan: Scan, runs: int) -> None:
    # The scan is made in the part's frame. Every point asked about one by one is the oracle: a point that was taken
    # together with others must have had its closest place on the face that they share.
    T = disturbance(np.random.default_rng(1), 1e-5, 1e-5 * SIZE, PART.centre)
    pairs = gathered(scan, SURFACE, T, runs, count=len(scan))
    alone = find_correspondences(scan, SURFACE, T)
    counts = pairs.scan.counts
    assert counts is not None
    assert pairs.scan.represented == len(scan)
    assert len(pairs.scan) < 0.7 * len(scan)
    assert counts @ pairs.squares == pytest.approx(float((alone.distances**2).sum()), rel=1e-9)
    np.testing.assert_allclose(counts @ pairs.scan.points, scan.points.sum(axis=0), atol=1e-9 * SIZE * len(scan))
    # Rows that are the mean of many lie on one face: the surface itself says the same.
    again = find_correspondences(pairs.scan, SURFACE, T)
    np.testing.assert_allclose(pairs.distances, again.distances, atol=1e-12 * SIZE)


def test_the_pose_is_that_of_all_points(scan: Scan) -> None:
    # One step to planes from the same pose; the lever of a point within its run is what is left out. Noise alone leaves
    # ten times as much open.
    T = disturbance(np.random.default_rng(2), 1e-4, 1e-4 * SIZE, PART.centre)
    pairs = gathered(scan, SURFACE, T, 5_000, count=len(scan))
    together = points_to_planes(pairs, pairs.scan.counts, NOISE).T_target_source
    each = points_to_planes(find_correspondences(scan, SURFACE, T), np.ones(len(scan)), NOISE).T_target_source
    assert worst_vertex_displacement(together, each, PART.vertices) <= 3e-7 * SIZE


def test_the_information_is_that_of_all_points(scan: Scan) -> None:
    def information(pairs: Correspondences):
        counts = pairs.scan.counts
        weights = np.ones(len(pairs.scan)) if counts is None else counts
        return information_of(
            pairs.moved, pairs.closest.normals, pairs.point_to_plane, weights, 0.5 * SIZE, PART.centre,
            counts=counts, scattered=pairs.scan.scatter,
        )  # fmt: skip

    together = information(gathered(scan, SURFACE, np.eye(4), 5_000, count=len(scan)))
    each = information(find_correspondences(scan, SURFACE, np.eye(4)))
    np.testing.assert_allclose(together.values, each.values, rtol=2e-3)
    np.testing.assert_allclose(together.carriers, each.carriers, rtol=1e-2)
    assert together.sigma == pytest.approx(each.sigma, rel=2e-3)
    assert together.weight == pytest.approx(each.weight, rel=1e-12)


def test_points_of_several_views_are_taken_together_view_by_view(scan: Scan) -> None:
    # One view may scatter less across a face than another, and each is weighted by what it scatters.
    pairs = gathered(scan, SURFACE, np.eye(4), 2_000, count=len(scan))
    assert scan.parts is not None
    assert pairs.scan.parts is not None
    np.testing.assert_array_equal(np.bincount(pairs.scan.parts, pairs.scan.counts), np.bincount(scan.parts))


def test_the_order_of_a_shuffled_scan_tells_no_views() -> None:
    points = np.random.default_rng(0).permutation(bracket_points(300, seed=0))
    pairs = gathered(prepare_scan(PointCloud(points), fitted=2_000), SURFACE, np.eye(4), 2_000, count=len(points))
    assert pairs.scan.parts is not None
    assert (pairs.scan.parts[pairs.scan.counts > 1] == CLOUD_PARTS).all()


def test_a_few_of_the_others_are_asked_about(scan: Scan) -> None:
    pairs = gathered(scan, SURFACE, np.eye(4), 2_000, count=1_000)
    assert pairs.scan.counts is not None
    assert np.count_nonzero(pairs.scan.counts == 1.0) == pytest.approx(1_000, rel=0.1)
    assert len(pairs.scan) <= 3_000


@pytest.mark.parametrize("thickness", [2.0, 3.0])
def test_the_two_sides_of_a_sheet_are_not_taken_for_one(thickness: float) -> None:
    # Thinner than the neighbourhood of a run, which holds points of both sides; in units of the noise.
    sheet = Mesh(*box((1.0, 1.0, thickness * 1e-3)))
    rng = np.random.default_rng(0)
    side = rng.choice([-0.5, 0.5], 40_000) * thickness * 1e-3
    points = np.column_stack([rng.uniform(-0.5, 0.5, (40_000, 2)), side + rng.normal(0.0, 1e-3, 40_000)])
    pairs = gathered(prepare_scan(PointCloud(points), 100), MeshSurface(sheet), np.eye(4), 500, 500, width=1e-3)
    assert pairs.scan.counts is not None
    assert np.mean(pairs.scan.counts > 1.0) <= 0.2


def test_noise_that_a_run_shares_does_not_take_its_weight(scan: Scan) -> None:
    # One displacement for each cube of space of a twelfth of the size. If runs that it moves by two widths were drawn
    # point by point, as those of two faces are, they would weigh a tenth: 0.84 of the scatter that all points have.
    rng = np.random.default_rng(4)
    _, cubes = np.unique(np.floor(scan.points / (SIZE / 12)).astype(int), axis=0, return_inverse=True)
    moved = scan.points + NOISE * rng.normal(size=(cubes.max() + 1, 3))[cubes.ravel()]
    pairs = gathered(dataclasses.replace(scan, points=moved), SURFACE, np.eye(4), 2_000, count=1_000)
    alone = find_correspondences(dataclasses.replace(scan, points=moved), SURFACE, np.eye(4))
    together = np.sqrt(np.average(pairs.squares, weights=pairs.scan.counts))
    assert together == pytest.approx(np.sqrt(np.mean(alone.distances**2)), rel=0.05)


def test_strays_in_a_run_are_left_out_of_its_mean(scan: Scan) -> None:
    rng = np.random.default_rng(0)
    spoilt = scan.points.copy()
    rows = rng.choice(len(scan), len(scan) // 20, replace=False)
    spoilt[rows] += rng.normal(0.0, 0.05 * SIZE, (len(rows), 3))
    pairs = gathered(dataclasses.replace(scan, points=spoilt), SURFACE, np.eye(4), 2_000, count=0)
    clean = find_correspondences(scan, SURFACE, np.eye(4))
    assert np.abs(pairs.distances).max() <= np.abs(clean.distances).max()
    T = points_to_planes(pairs, pairs.scan.counts, NOISE).T_target_source
    assert pose.angle_between(T, np.eye(4)) <= 1e-4
