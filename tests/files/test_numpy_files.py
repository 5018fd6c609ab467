from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_cloud

FAR = np.array([[4400000.123456, -2.5, 3.0], [4.0, 5.0, 6.0]])
UP = np.tile([0.0, 0.0, 1.0], (2, 1))


@pytest.mark.parametrize("array", [FAR, np.asfortranarray(FAR), FAR.astype(">f8"), np.hstack([FAR, UP])])
def test_an_array_comes_back(tmp_path: Path, array: np.ndarray) -> None:
    file = tmp_path / "scan.npy"
    np.save(file, array)
    cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, FAR)
    assert (cloud.normals is None) == (array.shape[1] == 3)


def test_a_fourth_column_is_an_intensity(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", np.hstack([FAR, [[0.5], [np.nan]]]))
    cloud = read_cloud(tmp_path / "scan.npy")
    np.testing.assert_array_equal(cloud.points, FAR)
    assert cloud.normals is None


def test_integers_are_coordinates(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", np.arange(6, dtype=np.uint16).reshape(2, 3))
    assert read_cloud(tmp_path / "scan.npy").points.tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_named_arrays_come_back(tmp_path: Path, save: Any) -> None:
    file = tmp_path / "scan.npz"
    save(file, points=np.vstack([FAR, [[np.nan, 0, 0]]]), normals=np.vstack([UP, UP[:1]]), intensity=np.zeros(3))
    cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, FAR)
    np.testing.assert_array_equal(cloud.normals, UP)
    assert cloud.dropped == 1


class Trap:
    def __reduce__(self) -> tuple[Any, ...]:
        return (pytest.fail, ("a pickle was run",))


@pytest.mark.parametrize("name", ["scan.npy", "scan.npz"])
def test_a_pickle_is_never_run(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    trap = np.array([[Trap(), Trap(), Trap()]], dtype=object)
    if name.endswith("z"):
        np.savez(file, points=trap, allow_pickle=True)
    else:
        np.save(file, trap, allow_pickle=True)
    with pytest.raises(InputError, match="no plain array"):
        read_cloud(file)


def test_a_bare_pickle_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.npy"
    file.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(InputError, match="no plain array"):
        read_cloud(file)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros(3), r"shape \(3,\)"),
        (np.zeros((2, 5)), r"of shape \(2, 5\); expected shape \(n, 3\), \(n, 4\) with an intensity"),
        (np.zeros((48, 64)), r"of shape \(48, 64\); expected .* of a depth image dqreg.PointCloud.from_depth"),
        (np.zeros((3, 50)), r"of shape \(3, 50\); expected .* save its transpose"),
        (np.eye(4), r"of shape \(4, 4\)"),
        (np.zeros((2, 3, 1)), r"shape \(2, 3, 1\)"),
        (np.zeros((2, 3), dtype=complex), "complex128"),
        (np.zeros((2, 3), dtype=bool), "bool"),
        (np.array([["a", "b", "c"]]), "type <U1"),
        (np.full((2, 3), np.nan), "all NaN or infinite"),
        (np.zeros((0, 3)), "no points|no plain array"),
        (np.hstack([FAR, 99 * UP]), "typical length of 99"),
    ],
)
def test_an_array_that_is_no_cloud_is_refused(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "scan.npy", array)
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "scan.npy")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"xyz": FAR}, "the arrays xyz; expected an array named points"),
        ({"points": FAR[:, :2]}, r"points of shape \(2, 2\)"),
        ({"points": FAR, "normals": UP[:1]}, r"normals of shape \(1, 3\)"),
        ({"points": FAR, "offsets": [0, 2], "scale": 0.001}, "a packed sequence of scans"),
        ({"points": np.zeros(3)}, r"points of shape \(3,\)"),
    ],
)
def test_arrays_that_are_no_cloud_are_refused(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    np.savez(tmp_path / "scan.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "scan.npz")


def test_a_header_that_promises_too_much_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", FAR)
    whole = (tmp_path / "scan.npy").read_bytes()
    lie = whole.replace(b"'shape': (2, 3), }" + b" " * 12, b"'shape': (2000000000000, 3), }")
    assert lie != whole
    (tmp_path / "scan.npy").write_bytes(lie)
    with pytest.raises(InputError, match="no plain array"):
        read_cloud(tmp_path / "scan.npy")
    with zipfile.ZipFile(tmp_path / "scan.npz", "w") as archive:
        archive.writestr("points.npy", lie)
    with pytest.raises(InputError, match="promises 48000000000000 bytes"):
        read_cloud(tmp_path / "scan.npz")


def test_a_header_that_is_no_python_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", FAR)
    broken = (tmp_path / "scan.npy").read_bytes().replace(b"(2, 3), }", b"(2, ((((")
    (tmp_path / "scan.npy").write_bytes(broken)
    with zipfile.ZipFile(tmp_path / "scan.npz", "w") as archive:
        archive.writestr("points.npy", broken)
    for name in ("scan.npy", "scan.npz"):
        with pytest.raises(InputError, match="no plain array"):
            read_cloud(tmp_path / name)


@pytest.mark.parametrize("name", ["scan.npy", "scan.npz"])
@pytest.mark.parametrize("kept", [0.3, 0.7, 0.99])
def test_a_file_cut_short_is_refused(tmp_path: Path, name: str, kept: float) -> None:
    file = tmp_path / name
    if name.endswith("z"):
        np.savez(file, points=FAR)
    else:
        np.save(file, FAR)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(InputError, match=r"no plain array|damaged archive"):
        read_cloud(file)


def test_a_damaged_archive_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.npz"
    np.savez_compressed(file, points=np.random.default_rng(1).normal(size=(500, 3)))
    whole = bytearray(file.read_bytes())
    whole[2000:2100] = bytes(100)
    file.write_bytes(whole)
    with pytest.raises(InputError, match=r"damaged archive|no plain array"):
        read_cloud(file)
