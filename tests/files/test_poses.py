from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.files.poses import read_pose, read_start
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose

T = pose.random(np.random.default_rng(11), reach=10.0)


def written(folder: Path, name: str, T: np.ndarray) -> Path:
    path = folder / name
    if path.suffix == ".npy":
        np.save(path, T)
    elif path.suffix == ".json":
        path.write_text(json.dumps({"T_target_source": T.tolist(), "anything": 1}))
    else:
        np.savetxt(path, T, fmt="%.17g", delimiter="," if path.suffix == ".csv" else " ")
    return path


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20)
def test_each_format_gives_the_same_numbers(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("poses")
    T = pose.random(np.random.default_rng(seed), reach=1e6)
    for name in ("a.txt", "a.csv", "a.json", "a.npy"):
        np.testing.assert_array_equal(read_pose(written(folder, name, T)), T)
        np.testing.assert_array_equal(read_start(folder / name), T)


@pytest.mark.parametrize("name", ["result", "result.txt", "r.dat"])
def test_a_result_is_read_under_any_name(tmp_path, name):
    written(tmp_path, "a.json", T).rename(tmp_path / name)
    np.testing.assert_array_equal(read_pose(tmp_path / name), T)


@pytest.mark.parametrize("name", ["a.txt", "a.json", "a.npy"])
def test_three_rows_are_enough(tmp_path, name):
    np.testing.assert_array_equal(read_pose(written(tmp_path, name, T[:3])), T)


@pytest.mark.parametrize("rows", [T, T[:3]])
def test_as_other_programs_write_it(tmp_path, rows):
    texts = (json.dumps(rows.tolist()), json.dumps(rows.tolist(), indent=1).replace("\n   ", ""),
             np.array2string(rows, floatmode="unique"), " ".join(map(repr, rows.ravel().tolist())))  # fmt: skip
    for number, text in enumerate(texts):
        for ending in (".txt", ".json") if number < 2 else (".txt",):
            path = tmp_path / f"{number}{ending}"
            path.write_text(text)
            np.testing.assert_array_equal(read_pose(path), T)


def test_a_result_is_a_start_and_one_without_a_pose_is_not(tmp_path):
    cube = np.random.default_rng(0).uniform(size=(500, 3)) * [3.0, 2.0, 1.0]
    result = register(cube, cube, "identity", effort="fast")
    result.save(tmp_path / "r.json")
    np.testing.assert_array_equal(
        read_start(tmp_path / "r.json"), Registration.load(tmp_path / "r.json").T_target_source
    )
    (tmp_path / "none.json").write_text(json.dumps({"T_target_source": [[None] * 4] * 4}))
    assert np.isnan(read_pose(tmp_path / "none.json")).all()
    with pytest.raises(InputError, match="no pose was found"):
        read_start(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.txt", b"# nothing but words\n", "empty"),
        ("a.txt", b"1 2\n3\n", "plain numbers"),
        ("a.txt", b"%PDF\0", "found binary data; expected a 4x4 pose of plain numbers"),
        ("a.txt", b"\0\0\0\0", "binary"),
        ("a.npy", b"\x93NUMPY\x01\x00", "no plain array"),
        ("a.npy", b"not an array", "no plain array"),
        ("a.json", b'{"T_target_source": [[1, 2], [3]]}', "4x4"),
        ("a.json", b"[" * 100_000, "plain numbers"),
    ],
)
def test_what_is_no_pose_is_named(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=said) as error:
        read_start(tmp_path / name)
    assert name in str(error.value)


def test_objects_in_an_array_are_never_run(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[{"a": 1}] * 4] * 4, dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="no plain array"):
        read_pose(tmp_path / "a.npy")


def test_a_mirror_is_no_start(tmp_path):
    with pytest.raises(InputError, match="mirror"):
        read_start(written(tmp_path, "a.npy", np.diag([1.0, 1.0, -1.0, 1.0])))
    with pytest.raises(InputError, match=r"no file.*nowhere\.txt"):
        read_start("nowhere.txt")
