from __future__ import annotations

import json

import numpy as np
import pytest

from dqreg.compare import read_pose, read_truth
from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.case_contents import symmetry_record
from dqreg.synth.parts import symmetry_of

T = pose.random(np.random.default_rng(3), reach=10.0)


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(" ".join(map(repr, row.tolist())) for row in T),
        "\n".join(", ".join(map(repr, row.tolist())) for row in T[:3]),
        "# from some program\n" + "\n".join(" ".join(map(repr, row.tolist())) for row in T),
    ],
)
def test_poses_of_text_files(tmp_path, text):
    (tmp_path / "pose.txt").write_text(text)
    np.testing.assert_array_equal(read_pose(tmp_path / "pose.txt"), T)
    np.testing.assert_allclose(read_truth(tmp_path / "pose.txt").poses, T[None], atol=1e-15)


def test_a_result_without_a_pose_is_nan(tmp_path):
    (tmp_path / "r.json").write_text(json.dumps({"T_target_source": [[None] * 4] * 4}))
    assert np.isnan(read_pose(tmp_path / "r.json")).all()
    with pytest.raises(InputError, match=r"r\.json"):
        read_truth(tmp_path / "r.json")


@pytest.mark.parametrize("kind", ["bracket", "box", "cylinder", "gear"])
def test_symmetries_as_cases_write_them(tmp_path, kind):
    symmetry = symmetry_of(kind)
    record = {"T_target_source": T.tolist(), **symmetry_record(symmetry, T)}
    (tmp_path / "truth.json").write_text(json.dumps(record))
    truth = read_truth(tmp_path / "truth.json")
    np.testing.assert_allclose(truth.poses, symmetry.poses @ T, atol=1e-12)
    assert (truth.axis is None) == (symmetry.axis is None)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("p.txt", "", "empty"),
        ("p.txt", "1 2 3\n4 5 6", "shape"),
        ("p.txt", "one two", "plain numbers"),
        ("p.json", "{}", "T_target_source"),
        ("p.json", "[1]", "4x4 numbers"),
        ("p.json", "{", "no readable JSON file"),
        ("p.json", '{"T_target_source": "no"}', "4x4"),
        ("p.json", json.dumps({"T_target_source": T.tolist(), "symmetric_truths": 3}), "list"),
        ("p.json", json.dumps({"T_target_source": T.tolist(), "symmetric_truths": [[1]]}), r"symmetric_truths\[0\]"),
        ("p.json", json.dumps({"T_target_source": T.tolist(), "symmetry_axis": [1]}), "point and direction"),
        ("p.json", json.dumps({"T_target_source": np.diag([1.0, 1, -1, 1]).tolist()}), "mirror"),
    ],
)
def test_bad_files_are_named(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said) as error:
        read_truth(tmp_path / name)
    assert name in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no\.txt"):
        read_pose(tmp_path / "no.txt")
