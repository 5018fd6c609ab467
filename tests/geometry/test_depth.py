from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dqreg._open3d import load_open3d
from dqreg.errors import InputError, UnitsError
from dqreg.geometry import PointCloud
from dqreg.geometry.depth import depth_points
from dqreg.rigid import pose

K = np.array([[60.0, 0, 19.5], [0, 70.0, 14.5], [0, 0, 1]])


def plane_depth(normal, distance):
    v, u = np.mgrid[:30, :40]
    rays = np.dstack([(u - 19.5) / 60.0, (v - 14.5) / 70.0, np.ones_like(u, dtype=float)])
    return distance / (rays @ normal)


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(0.1, 1e3))
def test_a_plane_is_met_exactly(x, y, distance):
    normal = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
    depth = plane_depth(normal, distance)
    assume(depth.min() > 0.0)
    cloud = PointCloud.from_depth(depth, K, depth_scale=1.0)
    np.testing.assert_allclose(cloud.points @ normal, distance, rtol=1e-12)
    np.testing.assert_allclose(cloud.normals, np.broadcast_to(-normal, cloud.points.shape), atol=1e-9)
    assert len(cloud) + cloud.dropped == 30 * 40


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_points_are_open3ds(seed):
    o3d = load_open3d()
    depth = np.random.default_rng(seed).integers(1, 60_000, (30, 40)).astype(np.uint16)
    camera = o3d.camera.PinholeCameraIntrinsic(40, 30, 60.0, 70.0, 19.5, 14.5)
    expected = o3d.geometry.PointCloud.create_from_depth_image(o3d.geometry.Image(depth), camera, depth_trunc=1e3)
    cloud = PointCloud.from_depth(depth, camera, normals=False)
    # Open3D keeps the depth as float32.
    np.testing.assert_allclose(cloud.points, np.asarray(expected.points), rtol=1e-6)


def test_invalid_depths_are_dropped_and_counted():
    depth = np.full((30, 40), 1500, dtype=np.uint16)
    depth[:3], depth[5, 5], depth[6, 6] = 0, 65535, 9000
    cloud = PointCloud.from_depth(depth, K, depth_trunc=5.0)
    assert cloud.dropped == 3 * 40 + 2
    assert np.ptp(cloud.points[:, 2]) == 0.0
    assert PointCloud.from_depth(depth, K, normals=False).dropped == 3 * 40 + 1
    floats = np.full((30, 40), 1.5)
    floats[0, :4] = [np.nan, np.inf, -1.0, 0.0]
    assert PointCloud.from_depth(floats, K).dropped == 4
    assert (cloud.units, cloud.viewpoint.tolist()) == ("m", [0, 0, 0])


def test_units_and_scale():
    depth = np.full((30, 40), 2000, dtype=np.uint16)
    assert PointCloud.from_depth(depth, K).points[0, 2] == 2.0
    millimetres = PointCloud.from_depth(depth, K, depth_scale=1.0, units="mm")
    assert (millimetres.points[0, 2], millimetres.units) == (2000.0, "mm")


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_millimetres_that_are_not_whole_are_are_not_taken_for_metres(kind):
    depth = np.random.default_rng(63_101).uniform(300.0, 4000.0, (30, 40)).astype(kind)
    with pytest.raises(UnitsError, match=r"depth_scale=1000, or depth_scale=1 "):
        PointCloud.from_depth(depth, K)
    for options, scale in (({"depth_scale": 1000}, 1000), ({"depth_scale": 1}, 1), ({"units": "mm"}, 1)):
        found = PointCloud.from_depth(depth, K, normals=False, **options)
        np.testing.assert_allclose(found.points[:, 2], depth.ravel() / scale, rtol=1e-6)
    # A street with much sky, in metres.
    street = np.where(np.arange(40) < 4, 8.0, 1000.0) * np.ones((30, 1), dtype=kind)
    assert len(PointCloud.from_depth(street, K, normals=False)) == 1200


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.int64, np.float32])
def test_what_cameras_write_for_no_depth_is_none_in_wider_types_too(kind):
    depth = np.full((30, 40), 1500).astype(kind)
    depth[3] = 65535
    assert PointCloud.from_depth(depth, K, depth_scale=1000, normals=False).dropped == 40


def test_a_step_does_not_bend_the_normals_beside_it():
    depth = np.full((30, 40), 2.0)
    depth[:, 20:] = 3.0
    cloud = PointCloud.from_depth(depth, K)
    np.testing.assert_allclose(cloud.normals, np.broadcast_to([0, 0, -1.0], cloud.points.shape), atol=1e-9)
    assert len(cloud) == 1200


def test_strays_have_no_plane_and_are_left_out_with_normals_only():
    depth = np.full((30, 40), np.nan)
    depth[10:20, 10:20] = 2.0
    depth[2, 2] = 1.0
    assert len(PointCloud.from_depth(depth, K)) == 100
    assert len(PointCloud.from_depth(depth, K, normals=False)) == 101


def test_stride_takes_every_other_pixel_with_the_normals_of_the_full_grid():
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    every, other = (depth_points(plane_depth(normal, 2.0), K, stride=s) for s in (1, 2))
    assert other.pixels.tolist() == [[v, u] for v, u in every.pixels.tolist() if v % 2 == 0 and u % 2 == 0]
    np.testing.assert_allclose(other.normals, np.broadcast_to(-normal, other.points.shape), atol=1e-9)


def test_the_image_stays_as_it_was():
    depth = plane_depth(np.array([0.0, 0.0, 1.0]), 2.0)
    before = depth.copy()
    PointCloud.from_depth(depth, (60.0, 70.0, 19.5, 14.5))
    np.testing.assert_array_equal(depth, before)


@pytest.mark.parametrize(
    ("depth", "camera", "options", "words"),
    [
        (np.zeros((4, 4)), K, {}, "none of the 16 pixels"),
        (np.ones((4, 4, 3)), K, {}, "shape"),
        (np.ones(4), K, {}, "shape"),
        (np.ones((4, 4), dtype=bool), K, {}, "mask"),
        (np.ones((4, 4)), K.T, {}, "intrinsics"),
        (np.ones((4, 4)), (0.0, 1.0, 2.0, 2.0), {}, "focal lengths"),
        (np.ones((4, 4)), K, {"stride": 0}, "stride"),
        (np.ones((4, 4)), K, {"depth_scale": 0.0}, "depth_scale"),
        (np.ones((4, 4)), K, {"depth_trunc": -1.0}, "depth_trunc"),
    ],
)
def test_what_cannot_be_used_is_said(depth, camera, options, words):
    with pytest.raises(InputError, match=words):
        PointCloud.from_depth(depth, camera, **options)


@pytest.mark.real
def test_a_kinects_frames_land_on_each_other(real_data: Path):
    # Poses of KinectFusion, good to about a centimetre and half a degree; steps of 1.2 and 1.8 degrees.
    from dqreg.registration.register import register

    folder, o3d = real_data / "sevenscenes_rgbd", load_open3d()
    camera = np.loadtxt(folder / "camera-intrinsics.txt")

    def frame(number):
        image = o3d.io.read_image(str(folder / f"frame-{number:06d}.depth.png"))
        return PointCloud.from_depth(np.asarray(image), camera, depth_trunc=4.0, stride=2)

    for number in (15, 30):
        result = register(frame(number), frame(number - 15), start="identity", effort="fast")
        a, b = (np.loadtxt(folder / f"frame-{n:06d}.pose.txt") for n in (number - 15, number))
        truth = np.linalg.inv(a) @ b
        assert result.verdict.level == "accepted"
        assert np.linalg.norm(result.T_target_source[:3, 3] - truth[:3, 3]) < 0.02
        assert pose.angle_between(result.T_target_source, truth) < np.deg2rad(0.5)
