"""Scans as surveyors, cars and laser scanners write them: LAS, LAZ, E57, KITTI's frames, PTS."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.errors import InputError, MissingDependencyError
from dqreg.files import read_cloud
from dqreg.files.cloud_data import TimedCloudData
from dqreg.rigid import twist
from tests.hostile.good_files import POINTS, UTM, e57, good_files, las

# The file turns the scan by a third of a circle about the diagonal: x becomes y, y becomes z.
TURNED = POINTS.astype(np.float64)[:, [2, 0, 1]]


@pytest.mark.parametrize("extension", [".las", ".laz"])
def test_las_in_utm_is_exact_to_half_a_step(extension, tmp_path):
    pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    path = tmp_path / f"a{extension}"
    path.write_bytes(las(extension))
    cloud = read_cloud(path)
    # Steps of 1e-3, and the rounding of coordinates in the millions.
    assert np.abs(cloud.points - UTM - POINTS).max() <= 0.5e-3 + 1e-9
    steps = (cloud.points - UTM) / 1e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=2e-6)
    assert isinstance(cloud, TimedCloudData)
    np.testing.assert_array_equal(cloud.times, np.arange(12.0))


def test_withheld_points_are_left_out_and_units_are_known(tmp_path):
    laspy = pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    path = tmp_path / "a.las"
    path.write_bytes(las(".las"))
    changed = laspy.read(path)
    changed.withheld[3] = 1
    keys = np.array([1, 1, 0, 1, 3076, 0, 1, 9001], dtype="<u2").tobytes()
    changed.header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys))
    changed.write(path)
    cloud = read_cloud(path)
    assert (len(cloud.points), cloud.dropped, cloud.units) == (11, 1, "m")


@pytest.mark.parametrize("translation", [(1.0, 2.0, 3.0), tuple(UTM)])
def test_e57_is_in_the_frame_of_the_file_with_the_scanner_as_viewpoint(translation, tmp_path):
    pytest.importorskip("pye57", reason="pip install 'dqreg[scans]'")
    path = tmp_path / "a.e57"
    path.write_bytes(e57(translation))
    cloud = read_cloud(path)
    # The file holds float32 coordinates from the scanner and its pose in float64.
    assert np.abs(cloud.points - translation - TURNED).max() <= 1e-7 + 1e-9
    assert (cloud.units, cloud.viewpoint.tolist()) == ("m", list(translation))


def test_e57_of_several_setups_is_one_cloud_without_a_viewpoint(tmp_path):
    pytest.importorskip("pye57", reason="pip install 'dqreg[scans]'")
    path = tmp_path / "a.e57"
    path.write_bytes(e57(copies=2))
    cloud = read_cloud(path)
    assert (len(cloud.points), cloud.viewpoint) == (24, None)
    np.testing.assert_allclose(cloud.points[12:] - cloud.points[:12], np.tile([0.0, 0.0, 5.0], (12, 1)), atol=1e-6)


@pytest.mark.parametrize("rotation", [None, (1.0, 0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0)])
def test_e57_without_a_pose_or_with_the_identity_tells_no_place(rotation, tmp_path):
    pytest.importorskip("pye57", reason="pip install 'dqreg[scans]'")
    path = tmp_path / "a.e57"
    path.write_bytes(e57((0.0, 0.0, 0.0), rotation=rotation))
    assert read_cloud(path).viewpoint is None
    # A levelled scanner at the origin of its project has a pose.
    path.write_bytes(e57((0.0, 0.0, 0.0)))
    assert read_cloud(path).viewpoint.tolist() == [0.0, 0.0, 0.0]


def test_kitti_and_pts(tmp_path):
    for name in ("kitti", "pts"):
        suffix, content = good_files()[name]
        (tmp_path / f"a{suffix}").write_bytes(content)
    frame = read_cloud(tmp_path / "a.bin")
    np.testing.assert_array_equal(frame.points, POINTS)
    assert (frame.units, frame.viewpoint.tolist()) == ("m", [0.0, 0.0, 0.0])
    np.testing.assert_allclose(read_cloud(tmp_path / "a.pts").points, POINTS, atol=1e-6)
    rows = "1 2 3 -5 255 0 0\n"
    (tmp_path / "b.pts").write_text(f"2\n{rows}{rows}1\n4 5 6 7 0 0 0\n")
    assert read_cloud(tmp_path / "b.pts").points.tolist() == [[1, 2, 3], [1, 2, 3], [4, 5, 6]]


def test_frames_of_nuscenes_have_a_fifth_number(tmp_path):
    rings = np.column_stack([POINTS, np.full(len(POINTS), 200.0), np.arange(len(POINTS)) % 32]).astype("<f4")
    # A number of points that KITTI's four numbers would divide as well.
    whole = np.tile(rings, (4, 1))
    whole.tofile(tmp_path / "a.pcd.bin")
    frame = read_cloud(tmp_path / "a.pcd.bin")
    np.testing.assert_array_equal(frame.points, np.tile(POINTS, (4, 1)).astype(np.float32))
    whole[:, :4].tofile(tmp_path / "b.PCD.bin")
    with pytest.raises(InputError, match="nuScenes' frames: five float32"):
        read_cloud(tmp_path / "b.PCD.bin")


@pytest.mark.parametrize(("module", "extension"), [("laspy", ".las"), ("lazrs", ".laz"), ("pye57", ".e57")])
def test_a_missing_package_is_named_with_its_extra(monkeypatch, tmp_path, module, extension):
    monkeypatch.setitem(sys.modules, module, None)
    path = tmp_path / f"a{extension}"
    path.write_bytes(b"LASF" if "la" in extension else b"ASTM-E57")
    with pytest.raises(MissingDependencyError, match=r"pip install 'dqreg\[scans\]'"):
        read_cloud(path)


def test_a_damaged_laz_is_refused(tmp_path):
    pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    path, whole = tmp_path / "a.laz", las(".laz")
    # Sizes of layers of 4 GB, and a file cut in its middle.
    for content in (whole[:509] + b"\xff" * 40 + whole[549:], whole[:520]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"a\.laz: found"):
            read_cloud(path)


@pytest.mark.parametrize(("extension", "package"), [(".las", "laspy"), (".laz", "laspy"), (".e57", "pye57")])
def test_half_a_file_is_asked_whether_it_was_cut_short(extension, package, tmp_path):
    pytest.importorskip(package, reason="pip install 'dqreg[scans]'")
    whole = e57() if extension == ".e57" else las(extension)
    path = tmp_path / f"a{extension}"
    path.write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(InputError, match=r"was the file cut short\?"):
        read_cloud(path)


def test_surveys_far_from_the_origin_register(tmp_path):
    pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    import laspy

    rng = np.random.default_rng(0)
    box = rng.uniform(-1, 1, (3000, 3)) * [8.0, 5.0, 3.0]
    box[np.arange(3000), np.arange(3000) % 3] = np.array([8.0, 5.0, 3.0])[np.arange(3000) % 3]
    R = twist.exp([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])[:3, :3]
    for name, points in (("scan", box @ R.T), ("map", box)):
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = [1e-4] * 3, UTM
        made = laspy.LasData(header)
        made.xyz = points + UTM
        made.write(tmp_path / f"{name}.las")
    result = dqreg.register(Path(tmp_path / "scan.las"), tmp_path / "map.las", "identity")
    moved = result.apply(box @ R.T + UTM) - UTM
    # The same points on both sides, each off by half a step of 1e-4 at most.
    assert np.abs(moved - box).max() <= 1e-3
