from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import READERS, CloudData, MeshData, read_cloud, read_geometry, read_mesh

pytestmark = pytest.mark.real

# Points, normals and dropped rows as the manifest of the collection, or the header of the file, states them.
CLOUDS = [
    ("small_gicp_kitti_pair/source.ply", 69792, False, 0),
    ("pcl_bunny/bun0.pcd", 397, True, 0),
    ("pcl_bunny/bun4.pcd", 361, False, 0),
    ("weld_tee_scan_cad/table_8in10in_tee_x4y24_45.pcd", 77393, False, 0),
    ("weld_tee_scan_cad/8in10in_tee_01_blndrB.pcd", 4981, True, 0),
    ("pcl_milk_scene/milk.pcd", 13704, False, 0),
    ("pcl_milk_scene/milk_cartoon_all_small_clorox.pcd", 241407, False, 307200 - 241407),
    ("libpointmatcher_car/car_cloud400.csv", 24989, True, 0),
    # No header: all 25193 lines are points.
    ("libpointmatcher_car/car_cloud401.csv", 25193, False, 0),
    ("simpleicp/dragon1.ply", 100000, False, 0),
    ("stanford_bunny_range/bun000.ply", 40256, False, 0),
]
# Faces as the manifest states them.
MESHES = [
    ("1002_tray_bottom.STL", 4520, None),
    ("ADIS16480.STL", 7436, None),
    ("angle_block.STL", 704, None),
    ("featuretype.STL", 3476, None),
    ("idler_riser.STL", 1572, None),
    ("plate_holes.STL", 1252, None),
    ("round.stl", 1120, None),
    ("octagonal_pocket.ply", 3262, None),
    ("fixed_top.ply", 4772, None),
    ("counterXP.3MF", 83750, "mm"),
]


@pytest.mark.parametrize(("name", "count", "normals", "dropped"), CLOUDS)
def test_clouds_have_the_stated_points(real_data: Path, name: str, count: int, normals: bool, dropped: int) -> None:
    cloud = read_cloud(real_data / name)
    assert (len(cloud.points), cloud.normals is not None, cloud.dropped) == (count, normals, dropped)


# Three of these write 0 and 1e-17 for the same corner; bit-equal merging left them open.
@pytest.mark.parametrize(("name", "faces", "units"), MESHES)
def test_cad_is_closed_after_merging(real_data: Path, name: str, faces: int, units: str | None) -> None:
    if name.endswith("3MF"):
        pytest.importorskip("lxml")
        pytest.importorskip("networkx")
    mesh = read_mesh(real_data / "trimesh_cad" / name)
    assert (len(mesh.faces), mesh.units) == (faces, units)
    # In a closed surface each edge is walked once in each sense.
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys, back = edges @ [len(mesh.vertices), 1], edges @ [1, len(mesh.vertices)]
    np.testing.assert_array_equal(np.sort(keys), np.sort(back))


def read_or_refusal(path: Path) -> CloudData | MeshData | InputError:
    try:
        return read_geometry(path)
    except InputError as error:
        return error


def test_every_file_is_read_or_refused_in_words(real_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    read = refused = 0
    for path in sorted(real_data.rglob("*")):
        if path.is_dir() or path.suffix == ".png":
            continue
        data = read_or_refusal(path)
        if isinstance(data, InputError):
            assert str(path) in str(data)
            refused += 1
        else:
            assert np.isfinite(data.points if isinstance(data, CloudData) else data.vertices).all()
            read += path.suffix.lower() in READERS
    assert read >= 30
    assert refused
    assert capfd.readouterr() == ("", "")
