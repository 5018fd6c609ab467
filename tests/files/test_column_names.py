"""Columns go by the same names whatever holds them: a table, a PLY or PCD file, a structured array."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.files import read_cloud
from dqreg.files.cloud_data import TimedCloudData
from dqreg.files.column_names import NORMAL_NAMES, POSITION_NAMES, TIME_NAMES
from dqreg.geometry import PointCloud, as_geometry

ROWS = np.array([[1.0, 2.0, 3.0, 0.5, 0.0, 1.0, 0.0], [4.0, 5.0, 6.0, 0.25, 1.0, 0.0, 0.0]])
AXES = ("x", "y", "z")


def as_ply(names: list[str]) -> str:
    properties = "".join(f"property double {name}\n" for name in names)
    return f"ply\nformat ascii 1.0\nelement vertex {len(ROWS)}\n{properties}end_header\n"


def as_pcd(names: list[str]) -> str:
    each = len(names)
    columns = f"SIZE{' 8' * each}\nTYPE{' F' * each}\nCOUNT{' 1' * each}\n"
    count = f"WIDTH {len(ROWS)}\nHEIGHT 1\nPOINTS {len(ROWS)}\n"
    return f"VERSION .7\nFIELDS {' '.join(names)}\n{columns}{count}DATA ascii\n"


HEADS = {".csv": lambda names: ",".join(names) + "\n", ".ply": as_ply, ".pcd": as_pcd}


def written(path: Path, names: list[str]) -> Any:
    """The first columns of the rows as a file."""
    between = "," if path.suffix == ".csv" else " "
    rows = "".join(between.join(map(str, row[: len(names)])) + "\n" for row in ROWS.tolist())
    path.write_text(HEADS[path.suffix](names) + rows)
    return read_cloud(path)


def in_array(names: list[str]) -> PointCloud:
    """The same as a structured array."""
    table = np.array([tuple(row[: len(names)]) for row in ROWS], dtype=[(name, "f8") for name in names])
    found = as_geometry(table, "source")
    assert isinstance(found, PointCloud)
    return found


@pytest.mark.parametrize("suffix", HEADS)
@pytest.mark.parametrize("name", [*TIME_NAMES, "Time"])
def test_times_have_the_same_names_everywhere(suffix: str, name: str, tmp_path: Path) -> None:
    names = [*AXES, name]
    cloud = written(tmp_path / f"a{suffix}", names)
    assert isinstance(cloud, TimedCloudData)
    np.testing.assert_array_equal(cloud.times, ROWS[:, 3])
    np.testing.assert_array_equal(cloud.points, ROWS[:, :3])
    np.testing.assert_array_equal(in_array(names).times, ROWS[:, 3])


@pytest.mark.parametrize("suffix", HEADS)
@pytest.mark.parametrize("axes", POSITION_NAMES)
@pytest.mark.parametrize("trio", NORMAL_NAMES)
def test_positions_and_normals_have_the_same_names_everywhere(
    suffix: str, axes: tuple[str, ...], trio: tuple[str, ...], tmp_path: Path
) -> None:
    names = [*axes, "intensity", *trio]
    for cloud in (written(tmp_path / f"a{suffix}", names), in_array(names)):
        np.testing.assert_array_equal(cloud.points, ROWS[:, :3])
        np.testing.assert_array_equal(cloud.normals, ROWS[:, 4:])


def test_of_two_columns_of_times_all_take_the_same(tmp_path: Path) -> None:
    names = [*AXES, "timestamp", "time"]
    cloud = written(tmp_path / "a.ply", names)
    assert isinstance(cloud, TimedCloudData)
    np.testing.assert_array_equal(cloud.times, in_array(names).times)


@pytest.mark.parametrize("times", [("12:00:01", "12:00:02"), ("0.5", "late"), ("2026-11-27", "3")])
def test_times_in_words_are_none(times: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"x,y,z,time\n1,2,3,{times[0]}\n4,5,6,{times[1]}\n")
    cloud = read_cloud(tmp_path / "a.csv")
    assert not isinstance(cloud, TimedCloudData)
    np.testing.assert_array_equal(cloud.points, ROWS[:, :3])


def test_a_time_that_is_missing_costs_no_point(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y;z;Time\n1;2;3;0,5\n4;5;6;\n")
    cloud = read_cloud(tmp_path / "a.csv")
    assert isinstance(cloud, TimedCloudData)
    np.testing.assert_array_equal(cloud.times, [0.5, np.nan])
    assert cloud.dropped == 0
