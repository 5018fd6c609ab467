from __future__ import annotations

import numpy as np

import dqreg
from dqreg.geometry import PointCloud, prepare_scan
from dqreg.geometry.morton import distinct_in_order
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh
from dqreg.synth.parts import bracket
from dqreg.trust.patch_tests import isolated


def test_scattered_points_are_isolated_and_a_sheet_in_the_air_is_none():
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(0, 1, (4000, 2)), np.zeros(4000)])
    sheet = np.column_stack([rng.uniform(0, 0.5, (1000, 2)), np.full(1000, 0.3)])
    scattered = rng.uniform((0.0, 0.0, 0.02), 1.0, (800, 3))
    points = np.concatenate([flat, sheet, scattered])
    on = np.arange(len(points)) < 4000
    order = distinct_in_order(points)
    alone = np.zeros(len(points), dtype=bool)
    alone[order] = isolated(prepare_scan(PointCloud(points)), on[order])
    assert not alone[:4000].any()
    # Where scattered points come near the sheet they have its neighbours; the sheet itself keeps its own.
    assert alone[4000:5000].mean() < 0.01
    assert alone[5000:].mean() > 0.8
    assert not isolated(prepare_scan(PointCloud(points[:4])), on[:4]).any()


def test_a_right_pose_among_scattered_outliers_is_accepted():
    # A third of the points is scattered: 18 % of their patches, and more, would deviate as a whole.
    vertices, faces = bracket()
    rng = np.random.default_rng(5)
    noise = Noise(range_sigma=0.05)
    scan = scan_mesh(vertices, faces, Scanner(((1, 1, 1), (-1, 0.3, -0.8)), pixels=150), noise, rng=rng).points
    low, high = scan.min(axis=0), scan.max(axis=0)
    middle, half = 0.5 * (low + high), 0.75 * (high - low).max()
    strays = rng.uniform(middle - half, middle + half, (len(scan) * 3 // 7, 3))
    T = random_pose(rng, 100.0, np.zeros(3))
    result = dqreg.register(np.concatenate([scan, strays]) @ T[:3, :3].T + T[:3, 3], dqreg.Mesh(vertices, faces))
    assert result.verdict.level == "accepted", result.verdict.reasons
