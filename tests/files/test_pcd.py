from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_cloud

FAR = np.array([[4400000.123456, 5500000.654321, 1.0], [1.0, 2.0, 3.0]])


def pcd(data: str, points: int | str, **changes: str) -> bytes:
    entries = {
        "VERSION": "0.7",
        "FIELDS": "x y z",
        "SIZE": "8 8 8",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "WIDTH": str(points),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(points),
        "DATA": data,
    }
    lines = [f"{key} {value}" for key, value in (entries | changes).items() if value != "-"]
    return ("# .PCD v0.7 - Point Cloud Data file format\n" + "\n".join(lines) + "\n").encode()


@pytest.mark.parametrize(
    "content",
    [
        pcd("ascii", 2) + b"4400000.123456 5500000.654321 1\n1 2 3\n",
        pcd("ascii", 2, SIZE="4 4 4") + b"4400000.123456 5500000.654321 1\n1 2 3\n",
        pcd("ascii", 2, VERSION=".5", VIEWPOINT="-", COUNT="-") + b"4400000.123456 5500000.654321 1\n1 2 3",
        pcd("ascii", 2, POINTS="-") + b"4400000.123456 5500000.654321 1\n1 2 3\n",
        pcd("ascii", 2, WIDTH="1", HEIGHT="2") + b"4400000.123456 5500000.654321 1\n1 2 3\n",
        (pcd("ascii", 2) + b"4400000.123456 5500000.654321 1\n1 2 3\n").replace(b"\n", b"\r\n"),
        pcd("binary", 2) + FAR.tobytes(),
        pcd("binary", 2, FIELDS="x y z _ f _", SIZE="8 8 8 1 2 1", TYPE="F F F U I U", COUNT="1 1 1 3 2 4")
        + b"".join(row.tobytes() + bytes(11) for row in FAR),
        pcd("ascii", 2, FIELDS="f x y z", SIZE="4 8 8 8", TYPE="F F F F", COUNT="2 1 1 1")
        + b"9 9 4400000.123456 5500000.654321 1\n9 nan 1 2 3\n",
    ],
)
def test_every_layout_gives_all_digits(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "scan.pcd"
    file.write_bytes(content)
    cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, FAR)
    assert cloud.viewpoint is None
    assert cloud.dropped == 0


def test_compressed_is_what_open3d_wrote(tmp_path: Path) -> None:
    open3d = load_open3d()
    points = np.concatenate([np.repeat(FAR, 100, axis=0), [[np.nan, 0.0, 0.0]]])
    normals = np.tile([[0.0, 0.6, 0.8]], (201, 1))
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points))
    cloud.point.normals = open3d.core.Tensor(normals)
    file = tmp_path / "scan.pcd"
    open3d.t.io.write_point_cloud(str(file), cloud, compressed=True)
    assert b"binary_compressed" in file.read_bytes()
    read = read_cloud(file)
    np.testing.assert_array_equal(read.points, points[:-1])
    np.testing.assert_array_equal(read.normals, normals[:-1])
    assert read.dropped == 1


def test_nan_rows_of_a_depth_camera_are_counted(tmp_path: Path) -> None:
    file = tmp_path / "scan.pcd"
    file.write_bytes(pcd("ascii", 4, WIDTH="2", HEIGHT="2") + b"1 2 3\nnan nan nan\n4 5 6\ninf 0 0\n")
    cloud = read_cloud(file)
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert cloud.dropped == 2


def test_normals_and_viewpoint_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "scan.pcd"
    fields = "x y z _ normal_x normal_y normal_z _"
    sizes, kinds, ones = "4 4 4 1 4 4 4 1", "F F F U F F F U", "1 1 1 1 1 1 1 1"
    head = pcd("binary", 1, FIELDS=fields, SIZE=sizes, TYPE=kinds, COUNT=ones, VIEWPOINT="0.5 -2 1e3 1 0 0 0")
    file.write_bytes(head + struct.pack("<fffBfffB", 1, 2, 3, 0, 0, 1, 0, 0))
    cloud = read_cloud(file)
    assert cloud.normals is not None
    assert cloud.normals.tolist() == [[0.0, 1.0, 0.0]]
    assert cloud.viewpoint is not None
    assert cloud.viewpoint.tolist() == [0.5, -2.0, 1000.0]


def test_a_sensor_that_only_turned_stands_at_the_origin(tmp_path: Path) -> None:
    file = tmp_path / "scan.pcd"
    file.write_bytes(pcd("ascii", 1, VIEWPOINT="0 0 0 0 1 0 0") + b"1 2 3\n")
    viewpoint = read_cloud(file).viewpoint
    assert viewpoint is not None
    assert viewpoint.tolist() == [0.0, 0.0, 0.0]


PACKED = struct.pack("<II", 4, 24) + bytes(4)
PADDED = {"FIELDS": "x y z _", "SIZE": "4 4 4 4", "TYPE": "F F F U", "COUNT": "1 1 1 3"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"hello there\n1 2 3\n", "the header line 'hello there'"),
        (b"VERSION 0.7\nFIELDS x y z\n", "without its DATA line"),
        (b"VERSION 0.7\nDATA ascii\n", "without FIELDS, SIZE, TYPE, POINTS"),
        (pcd("ascii", 0), "no points"),
        (pcd("ascii", 2, WIDTH="3") + b"1 2 3\n4 5 6\n", "2 points in a grid of 3 x 1"),
        (pcd("ascii", "many"), "WIDTH many"),
        (pcd("ascii", 2, SIZE="8 8") + b"1 2 3\n4 5 6\n", "3 FIELDS, 2 SIZE"),
        (pcd("ascii", 2, SIZE="8 8 3") + b"1 2 3\n4 5 6\n", "TYPE F, SIZE 3"),
        (pcd("ascii", 2, TYPE="F F Q") + b"1 2 3\n4 5 6\n", "TYPE Q"),
        (pcd("ascii", 2, COUNT="1 1 0") + b"1 2 3\n4 5 6\n", "COUNT 0"),
        (pcd("ascii", 2, FIELDS="a y z") + b"1 2 3\n4 5 6\n", "columns a, y, z; expected columns named x, y and z"),
        (pcd("zipped", 2) + b"1 2 3\n4 5 6\n", "DATA zipped; expected one of ascii"),
        (pcd("ascii", 2, VIEWPOINT="0 0 1") + b"1 2 3\n4 5 6\n", "VIEWPOINT 0 0 1; expected seven"),
        (pcd("ascii", 2, VIEWPOINT="0 0 nan 1 0 0 0") + b"1 2 3\n4 5 6\n", "VIEWPOINT"),
        (pcd("ascii", 2) + b"1 2 3\n4.56789 5\n", "number of columns changed"),
        (pcd("ascii", 2) + b"1.2345 2.3456 3.4567\n", "1 lines of points"),
        (pcd("ascii", 2) + b"1 2 3 4\n4 5 6 7\n", "2 rows of 4 numbers"),
        (pcd("ascii", 10**15) + b"1 2 3\n", "promises 1000000000000000 points but only 6 bytes"),
        (pcd("binary", 10**15) + bytes(24), "promises 1000000000000000 points but only 24 bytes"),
        (pcd("binary", 2) + FAR.tobytes()[:-1], "only 47 bytes"),
        (pcd("binary_compressed", 10**8) + PACKED, "4 compressed bytes said to hold 24"),
        (pcd("binary_compressed", 10**8) + struct.pack("<II", 4, 2400000000), "4 compressed bytes said to hold 24000"),
        (pcd("binary_compressed", 1), "0 compressed bytes said to hold 0"),
        (pcd("binary_compressed", 1) + PACKED[:-1], "only 11 bytes"),
        (pcd("binary_compressed", 1) + PACKED, "cannot be unpacked"),
        (pcd("binary_compressed", 1, TYPE="F F I") + PACKED, "save it again with DATA binary"),
        (pcd("binary_compressed", 1, **PADDED) + PACKED, "padding"),
        (pcd("binary", 1, COUNT="1 1 99999999999") + bytes(24), "promises 1 points but only 24 bytes"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_in_words(
    tmp_path: Path, content: bytes, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "scan.pcd"
    file.write_bytes(content)
    load_open3d()
    capfd.readouterr()
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(file)
    assert str(caught.value).startswith(f"cannot read {file}: found ")
    assert capfd.readouterr() == ("", "")
