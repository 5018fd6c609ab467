"""Measured clouds against a mesh and against each other: range scans, a dragon, a LiDAR pair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.geometry import PointCloud
from dqreg.geometry.opening import as_geometry
from dqreg.registration.options.options import Effort
from dqreg.registration.register import register
from dqreg.rigid import pose, twist

pytestmark = pytest.mark.real


def turntable(angle_deg: float) -> FloatArray:
    # A positive turn about y is the sign that lies nearer to the stored poses T_world_scan (bun.conf with its
    # rotations transposed); the centre of the table is taken to be the origin, which is up to 61 mm off the mark.
    return twist.exp(np.array([0.0, np.deg2rad(angle_deg), 0.0, 0.0, 0.0, 0.0]))


def stored(folder: Path, scan: str) -> FloatArray:
    return np.loadtxt(folder / f"T_world_bun{scan}.txt")


def assert_close(T: FloatArray, T_expected: FloatArray, at: FloatArray, angle_deg: float, offset: float) -> None:
    assert pose.angle_between(T, T_expected) <= np.deg2rad(angle_deg)
    assert pose.offset_between(T, T_expected, at=at) <= offset


def middle(path: Path) -> FloatArray:
    cloud = as_geometry(path, "scan")
    assert isinstance(cloud, PointCloud)
    return cloud.points.mean(axis=0)


@pytest.mark.parametrize(
    "scan", ["000", *(pytest.param(scan, marks=pytest.mark.soak) for scan in ("045", "090", "180", "270", "315"))]
)
def test_a_range_scan_of_the_bunny_lands_on_the_merged_mesh(real_data: Path, scan: str) -> None:
    # Stored poses: the scanner's own multi-view alignment, from which the mesh was merged. The offset counts in the
    # middle of the scan; the bunny is 0.25 m across and the points lie 0.11-0.16 mm off the mesh.
    folder = real_data / "stanford_bunny_range"
    result = register(folder / f"bun{scan}.ply", folder / "bun_zipper.ply", turntable(float(scan)))
    assert result.verdict.level == "accepted"
    expected = stored(folder, scan)
    assert_close(result.T_target_source, expected, middle(folder / f"bun{scan}.ply"), angle_deg=0.2, offset=5e-4)


@pytest.mark.parametrize(
    ("target", "source"),
    [
        ("000", "045"),
        *(pytest.param(*pair, marks=pytest.mark.soak) for pair in [("045", "090"), ("000", "315"), ("315", "270")]),
    ],
)
def test_neighbouring_range_scans_fit_each_other(real_data: Path, target: str, source: str) -> None:
    # Two scans that overlap in part, against the stored poses of both.
    folder = real_data / "stanford_bunny_range"
    start = turntable(float(source) - float(target))
    result = register(folder / f"bun{source}.ply", folder / f"bun{target}.ply", start)
    expected = pose.inverse(stored(folder, target)) @ stored(folder, source)
    assert_close(result.T_target_source, expected, middle(folder / f"bun{source}.ply"), angle_deg=0.3, offset=5e-4)


def test_the_same_points_moved_come_back_to_their_rounding(real_data: Path) -> None:
    # Both dragons hold the same 100,000 points of a body 27 units across, written with four decimals: the pairs differ
    # by 5e-5 (rms). The stored pose is their least-squares fit, and so is ours once every pair is the true one:
    # measured 5e-7 degrees and 8e-8 units at the origin. The bounds are 20 times that: 1e-5 degrees, and 2e-6
    # units, a twentieth of the rounding of one coordinate and 8e-8 of the size.
    folder = real_data / "simpleicp"
    result = register(folder / "dragon2.ply", folder / "dragon1.ply", "identity")
    assert result.verdict.level == "accepted"
    expected = np.loadtxt(folder / "T_dragon1_dragon2_reference_icp.txt")
    assert_close(result.T_target_source, expected, np.zeros(3), angle_deg=1e-5, offset=2e-6)


@pytest.mark.parametrize("effort", ["normal", "best"])
def test_a_lidar_pair_from_identity(real_data: Path, effort: Effort) -> None:
    # The reference ships with the pair, whose owners ask for 2.5 degrees and 0.2 m; identity is 0.7 degrees and
    # 0.49 m off. The offset counts at the sensor.
    folder = real_data / "small_gicp_kitti_pair"
    result = register(folder / "source.ply", folder / "target.ply", "identity", effort=effort)
    assert result.verdict.level == "accepted"
    expected = np.loadtxt(folder / "T_target_source.txt")
    assert_close(result.T_target_source, expected, np.zeros(3), angle_deg=0.5, offset=0.05)


def test_two_sweeps_of_a_lidar_in_a_yard_from_identity(real_data: Path) -> None:
    # The reference is "from visual inspection" and good to about 2 cm and 0.2 degrees, whose owners ask for 0.1 m and
    # 0.1 rad; identity is 15 degrees off. Measured: 0.135 degrees and 1 cm at the sensor.
    folder = real_data / "libpointmatcher_car"
    target = as_geometry(folder / "car_cloud400.csv", "target")
    assert isinstance(target, PointCloud)
    result = register(folder / "car_cloud401.csv", target.points, "identity")
    assert result.verdict.level == "accepted"
    expected = np.loadtxt(folder / "T_400_401_utest_validT3d.txt")
    assert_close(result.T_target_source, expected, np.zeros(3), angle_deg=0.3, offset=0.04)


def test_neighbouring_fragments_of_a_kitchen_from_identity(real_data: Path) -> None:
    # Poses of the 3DMatch benchmark, whose rule is 15 degrees and 0.3 m; identity is 4.6 degrees and 0.17 m off.
    # Measured: 0.45 degrees, and 13 mm over the points of a room of 3 m.
    folder = real_data / "redkitchen_fragments"
    result = register(folder / "cloud_bin_1.ply", folder / "cloud_bin_0.ply", "identity")
    assert result.verdict.level == "accepted"
    expected = np.vstack([np.loadtxt(folder / "T_0_1.txt"), [0.0, 0.0, 0.0, 1.0]])[:4]
    assert_close(result.T_target_source, expected, middle(folder / "cloud_bin_1.ply"), angle_deg=0.7, offset=0.02)


@pytest.mark.parametrize("effort", ["normal", "best"])
@pytest.mark.parametrize("frame", [90, *(pytest.param(frame, marks=pytest.mark.soak) for frame in (120, 195, 300))])
def test_neighbouring_depth_images_from_identity(real_data: Path, frame: int, effort: Effort) -> None:
    # Poses from KinectFusion's tracking, good to about a degree and 2 cm; steps of 15 frames, up to 10 degrees. Depths
    # are rounded to terraces many points wide, which turn the planes of neighbouring points.
    folder = real_data / "sevenscenes_rgbd"
    camera = np.loadtxt(folder / "camera-intrinsics.txt")
    clouds, poses = [], []
    for number in (frame, frame - 15):
        image = np.asarray(load_open3d().io.read_image(str(folder / f"frame-{number:06d}.depth.png")))
        clouds.append(PointCloud.from_depth(image, camera, normals=False))
        poses.append(np.loadtxt(folder / f"frame-{number:06d}.pose.txt"))
    result = register(clouds[0], clouds[1], "identity", effort=effort)
    assert result.verdict.level == "accepted"
    expected = pose.inverse(poses[1]) @ poses[0]
    assert_close(result.T_target_source, expected, clouds[0].points.mean(axis=0), angle_deg=1.3, offset=0.02)


@pytest.mark.parametrize(("effort", "share"), [("fast", 0.5), ("normal", 0.75)])
def test_a_lidar_pair_is_no_worse_than_small_gicp_finds_it(real_data: Path, effort: Effort, share: float) -> None:
    # The reference is small_gicp's own answer with voxels of 0.1 m, to the last digit: that is what is told.
    # small_gicp with its manual's settings for this pair: 0.33 degrees, and 36 mm over all points; fast
    # comes to 0.15 and 17, normal to 0.19 and 21.
    gicp = pytest.importorskip("small_gicp")
    folder = real_data / "small_gicp_kitti_pair"
    source, target = (as_geometry(folder / f"{side}.ply", side).points for side in ("source", "target"))
    fixed, tree = gicp.preprocess_points(target, downsampling_resolution=0.25)
    moving, _ = gicp.preprocess_points(source, downsampling_resolution=0.25)
    peer = gicp.align(fixed, moving, tree, registration_type="GICP", max_correspondence_distance=1.0).T_target_source
    ours = register(source, target, "identity", effort=effort).T_target_source
    T_truth = np.loadtxt(folder / "T_target_source.txt")
    errors = [np.linalg.norm(pose.apply(T, source) - pose.apply(T_truth, source), axis=1) for T in (ours, peer)]
    assert np.sqrt((errors[0] ** 2).mean()) <= 0.75 * np.sqrt((errors[1] ** 2).mean())
    assert pose.angle_between(ours, T_truth) <= share * pose.angle_between(peer, T_truth)
