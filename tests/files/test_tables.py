from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_cloud

ROWS = [[4400000.123456, -2.5, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", "4400000.123456 -2.5 3\n4 5 6\n"),
        ("a.txt", "  4400000.123456\t-2.5\t3\r\n\r\n 4 5   6"),
        ("a.csv", "4400000.123456,-2.5,3\n4,5,6\n"),
        ("a.csv", "4400000.123456 , -2.5 ,3\n4,5, 6\n"),
        ("a.csv", "4400000.123456;-2.5;3\n4;5;6\n"),
        ("a.csv", "4400000,123456;-2,5;3,0\n4;5;6\n"),
        ("a.csv", "x,y,z\n4400000.123456,-2.5,3\n4,5,6\n"),
        ("a.csv", '\ufeff"X";"Y";"Z"\n4400000,123456;-2,5;3\n4;5;6\n'),
        ("a.csv", "label,z,y,x\nfirst,3,-2.5,4400000.123456\nsecond,6,5,4\n"),
        ("a.xyz", "2\n4400000.123456 -2.5 3\n4 5 6\n"),  # their number above
        ("a.xyz", "4400000.123456 -2.5 3 117\n4 5 6 90\n"),  # the fourth is an intensity
        ("a.asc", "4400000.123456;-2.5;3;117\n4;5;6;90\n"),
        ("a.csv", "x y z intensity\n4400000.123456,-2.5,3,7\n4,5,6,8\n"),
        ("a.xyz", "# made by a scanner: all x y z in metres\n4400000.123456 -2.5 3\n# the end\n4 5 6\n"),
        ("a.txt", "//X Y Z Quality\n4400000.123456 -2.5 3 1\n4 5 6 0\n"),
        ("a.xyz", "# z y x\n3 -2.5 4400000.123456\n6 5 4\n"),
        ("a.txt", "P1 4400000.123456 -2.5 3\nP2 4 5 6\n"),
        ("a.csv", "P 1;4400000,123456;-2,5;3;117\nP 2;4;5;6;90\n"),
        ("a.csv", "Point,X coord,Y coord,Z coord\nP1,4400000.123456,-2.5,3\nP2,4,5,6\n"),
        ("a.csv", '"Temp","Points:0","Points:1","Points:2"\n20,4400000.123456,-2.5,3\n21,4,5,6\n'),
        ("a.csv", "x_raw,x,y,z\n7,4400000.123456,-2.5,3\n8,4,5,6\n"),
        ("a.CSV", "X,Y,Z,comment with no number\n4400000.123456,-2.5,3,é\n4,5,6,\n"),
    ],
)
def test_every_dialect_gives_the_same_points(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_bytes(text.encode())
    cloud = read_cloud(file)
    assert cloud.points.tolist() == ROWS
    assert cloud.normals is None
    assert cloud.dropped == 0


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "1,2,3,0,0,1\n"),
        ("a.xyz", "1 2 3 0 0 1\n"),
        ("a.csv", "nx,ny,nz,x,y,z\n0,0,1,1,2,3\n"),
        ("a.csv", "x,y,z,normal_x,normal_y,normal_z\n1,2,3,0,0,1\n"),
    ],
)
def test_normals_are_found(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    cloud = read_cloud(file)
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0]]
    assert cloud.normals is not None
    assert cloud.normals.tolist() == [[0.0, 0.0, 1.0]]


def test_xyzn_promises_normals_of_any_length(tmp_path: Path) -> None:
    file = tmp_path / "a.xyzn"
    file.write_text("1 2 3 0 0 255\n")
    normals = read_cloud(file).normals
    assert normals is not None
    assert normals.tolist() == [[0.0, 0.0, 255.0]]


def test_empty_fields_and_infinities_are_dropped_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("x,y,z\n1,,3\n,2,3\n1,2,\n1,2,3\nnan,0,0\n1e999,0,0\n-inf,0,0\n")
    cloud = read_cloud(file)
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0]]
    assert cloud.dropped == 6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"\n\n", "no row of numbers"),
        (b"x,y,z\n", "no row of numbers"),
        (b"hello\nworld\n1 2 3\n", "the line 'world'; expected numbers below"),
        (b"1 2\n3 4\n", "2 columns; expected 3"),
        (b"1 2 3 4 5\n5 6 7 8 9\n", "5 columns; expected 3"),
        (b"1 2 3 255 128 0\n4 5 6 200 100 7\n", "columns 4 to 6 with a typical length of"),
        (b"1 2 3\n4 5\n", "columns changed from 3 to 2 at row 2"),
        (b"1 2 3\n4 five 6\n", "'five'"),
        (b"a,b,c\n1,2,3\n", "columns a, b, c; expected columns named x, y and z"),
        (b"x,y,z\n1,2,3,4\n", "3 column names over 4 columns"),
        (b"x,y,z,w\n1,2,3,4\n1,2\n", "row 2"),
        (b"x_mm,y_mm,z_um\n1,2,3\n", "x, y and z in mm and um; expected one length unit"),
        (b"x_raw,y_raw,z_raw\n1,2,3\n", "columns x_raw, y_raw, z_raw; expected columns named x, y and z"),
        (b"P1 1 2 3\nP2 4 five 6\n", "'five'"),
        (b"x,y,z\nnan,nan,nan\n", "1 points, all NaN or infinite"),
        (b"2\nwater\nO 0 0 0\nH 1 0 0\n", "could not convert|columns changed|line"),
        ("1 2 3\n".encode("utf-16"), "binary data; expected text"),
        (bytes(range(256)), "binary data"),
        (b"\xff\xd8\xff\xe0 JFIF", "a JPEG image"),
    ],
)
def test_a_bad_table_is_refused_in_words(tmp_path: Path, text: bytes, message: str) -> None:
    file = tmp_path / "scan.csv"
    file.write_bytes(text)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(file)
    assert str(caught.value).startswith(f"cannot read {file}: found ")
    assert ";" not in str(caught.value).split("; expected")[0]


def test_numbers_keep_every_digit(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    points = rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-9, 9, size=(500, 1))
    file = tmp_path / "a.csv"
    np.savetxt(file, points, fmt="%.17g", delimiter=",", header="x,y,z")
    np.testing.assert_array_equal(read_cloud(file).points, points)


def test_colours_from_0_to_1_are_not_taken_for_normals(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).uniform(0.0, 1.0, (500, 6))
    np.savetxt(tmp_path / "scan.xyz", colours)
    with pytest.raises(InputError, match="normals of length 1"):
        read_cloud(tmp_path / "scan.xyz")


@pytest.mark.parametrize("gap", [" ", "\t", "   ", ";", " ; "])
def test_a_comma_is_the_decimal_sign_beside_blanks_and_semicolons(tmp_path: Path, gap: str) -> None:
    points = np.array([[2420.13, -1.5, 0.25], [0.0, 3.0, -4e-3], [7.0, 8.5, 9.0]])
    rows = [gap.join(f"{x:g}".replace(".", ",") for x in row) for row in points]
    (tmp_path / "a.txt").write_text("x y z\n".replace(" ", gap) + "\n".join(rows) + "\n")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.txt").points, points)


def test_commas_that_part_columns_still_do(tmp_path: Path) -> None:
    for text in ("1.5,2,3\n4,5,6\n", "1.5, 2, 3\n4, 5, 6\n", "1.5 ,2 ,3\n4 ,5 ,6\n"):
        (tmp_path / "a.txt").write_text(text)
        np.testing.assert_array_equal(read_cloud(tmp_path / "a.txt").points, [[1.5, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        ("X [mm];Y [mm];Z [mm]", "mm"),
        ("X (mm),Y (mm),Z (mm)", "mm"),
        ("X [mm] Y [mm] Z [mm]", "mm"),
        ("x_mm,y_mm,z_mm", "mm"),
        ("X(m) Y(m) Z(m)", "m"),
        ("X-Position [inch],Y-Position [inch],Z-Position [inch]", "inch"),
        ("X Coordinate (µm),Y Coordinate (µm),Z Coordinate (µm)", "um"),
        ("# x_cm y_cm z_cm", "cm"),
        ("X [],Y [],Z []", None),
        ("Points_0,Points_1,Points_2", None),
    ],
)
def test_the_unit_of_the_column_names_is_that_of_the_points(tmp_path: Path, head: str, unit: str | None) -> None:
    gap = ";" if ";" in head else "," if "," in head else " "
    (tmp_path / "a.csv").write_text(f"{head}\n{gap.join('123')}\n{gap.join('456')}\n")
    cloud = read_cloud(tmp_path / "a.csv")
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert cloud.units == unit


def test_normals_beside_names_with_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x [mm],y [mm],z [mm],Normals:0,Normals:1,Normals:2\n1,2,3,0,0,1\n")
    cloud = read_cloud(tmp_path / "a.csv")
    assert cloud.units == "mm"
    assert cloud.normals is not None
    assert cloud.normals.tolist() == [[0.0, 0.0, 1.0]]


def numbered(rows: np.ndarray, first: int) -> np.ndarray:
    return np.column_stack([first + np.arange(len(rows)), rows])


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("normals", "ending"), [(False, ".txt"), (True, ".txt"), (False, ".npy")])
def test_a_column_that_counts_the_rows_is_no_coordinate(tmp_path: Path, first: int, normals: bool, ending: str) -> None:
    rng = np.random.default_rng(0)
    points, up = rng.normal(size=(20, 3)), np.tile([0.0, 0.0, 1.0], (20, 1))
    table = numbered(np.hstack([points, up]) if normals else points, first)
    file = tmp_path / f"a{ending}"
    if ending == ".npy":
        np.save(file, table)
    else:
        np.savetxt(file, table, fmt="%.17g")
    with pytest.warns(UserWarning, match="the first of . columns counts the rows and is taken for their numbers"):
        cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, points)
    assert (cloud.normals is not None) == normals


@pytest.mark.parametrize("change", ["gap", "few", "start", "order"])
def test_an_x_that_only_looks_like_a_counter_is_x(tmp_path: Path, change: str) -> None:
    table = numbered(np.random.default_rng(0).normal(size=(20, 3)), 0)
    if change == "gap":
        table[-1, 0] += 1
    elif change == "few":
        table = table[:4]
    elif change == "start":
        table[:, 0] += 2
    else:
        table[[3, 4]] = table[[4, 3]]
    np.savetxt(tmp_path / "a.xyz", table, fmt="%.17g")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.xyz").points, table[:, :3])
