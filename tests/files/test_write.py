from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_cloud, write_cloud

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.floats(width=32, allow_nan=False, allow_infinity=False)
)


@settings(deadline=None, max_examples=60)
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(1, 8), st.just(3)), elements=NUMBERS),
    st.booleans(),
)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray, with_normals: bool
) -> None:
    file = tmp_path_factory.mktemp("cloud") / "scan.ply"
    normals = np.tile([0.6, 0.0, 0.8], (len(points), 1)) if with_normals else None
    write_cloud(file, points, normals, colors=np.tile([0, 128, 255], (len(points), 1)))
    cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, points)
    assert (cloud.normals is None) == (normals is None)
    if normals is not None:
        np.testing.assert_array_equal(cloud.normals, normals)


@pytest.mark.parametrize(
    ("points", "kind"),
    [
        ([[0.5, 1, 2]], "float"),
        ([[0.1, 1, 2]], "double"),
        ([[4400000.123, 0, 0]], "double"),
        ([[1e300, 0, 0]], "double"),
    ],
)
def test_float32_is_used_where_it_loses_nothing(tmp_path: Path, points: list[list[float]], kind: str) -> None:
    write_cloud(tmp_path / "scan.ply", points)
    assert f"property {kind} x\n".encode() in (tmp_path / "scan.ply").read_bytes()


@pytest.mark.parametrize("colors", [np.array([[0, 128, 255]] * 2), np.array([[0.0, 0.502, 1.0]] * 2)])
def test_open3d_reads_it_too(tmp_path: Path, colors: np.ndarray) -> None:
    points, normals = [[0.1, 0.2, 0.3], [1, 2, 3]], [[0, 0, 1], [0, 1, 0]]
    write_cloud(tmp_path / "scan.ply", points, normals, colors)
    cloud = load_open3d().t.io.read_point_cloud(str(tmp_path / "scan.ply"))
    np.testing.assert_array_equal(cloud.point.positions.numpy(), points)
    np.testing.assert_array_equal(cloud.point.normals.numpy(), normals)
    np.testing.assert_array_equal(cloud.point.colors.numpy(), [[0, 128, 255]] * 2)


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("scan.xyz", {"points": [[0, 0, 0]]}, r"give a name that ends in \.ply"),
        ("scan.ply", {"points": np.zeros((0, 3))}, "there are no points"),
        ("scan.ply", {"points": [[0, 0]]}, r"points must have shape \(n, 3\)"),
        ("scan.ply", {"points": [[0, 0, np.nan]]}, "points holds 1 numbers that are NaN"),
        ("scan.ply", {"points": [[0, 0, 0]], "normals": np.eye(3)}, "normals must have one row per point; got 3 rows"),
        ("scan.ply", {"points": [[0, 0, 0]], "normals": [[0, 0, np.inf]]}, "normals holds 1 numbers"),
        ("scan.ply", {"points": [[0, 0, 0]], "colors": [[0, 0, 256]]}, "colors must be integers from 0 to 255"),
        ("scan.ply", {"points": [[0, 0, 0]], "colors": [[0, 0, 1.5]]}, "got 0 to 1.5"),
        ("gone/scan.ply", {"points": [[0, 0, 0]]}, "does not exist; create it first"),
    ],
)
def test_bad_input_leaves_no_file(tmp_path: Path, name: str, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_cloud(tmp_path / name, **arguments)
    assert list(tmp_path.iterdir()) == []


def test_fields_are_further_properties_and_comments_stay_on_their_lines(tmp_path: Path) -> None:
    values = np.array([0.1, -1e-300])
    write_cloud(tmp_path / "a.ply", np.eye(3)[:2], fields={"deviation": values}, comments=["two\nlines", "5 µm"])
    read = load_open3d().t.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read.point["deviation"].numpy().ravel(), values)
    assert b"comment two lines\ncomment 5 ?m\n" in (tmp_path / "a.ply").read_bytes()


@pytest.mark.parametrize(
    ("fields", "words"),
    [({"x": [1.0]}, "name of its own"), ({"a b": [1.0]}, "name of its own"), ({"a": [1.0, 2.0]}, "1 numbers")],
)
def test_a_field_needs_a_name_and_one_number_per_point(tmp_path: Path, fields: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        write_cloud(tmp_path / "a.ply", [[0.0, 0, 0]], fields=fields)
