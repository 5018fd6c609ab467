from __future__ import annotations

import dataclasses
import json
import os
import re

import pytest

from dqreg.errors import InputError
from dqreg.registration.batch import read_manifest
from dqreg.registration.batch.resume import open_folder
from dqreg.registration.batch.row import Targets, digest_of, run_row
from tests.hostile.good_files import gltf_tree
from tests.registration.batch.scenes import make_scene


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    scene = make_scene(tmp_path_factory.mktemp("scene"), 1)
    row = read_manifest(scene.manifest)[0]
    return row, dataclasses.replace(run_row(row, Targets()), thumbnail=b"picture")


def test_what_is_saved_is_finished(done, tmp_path):
    row, answer = done
    with open_folder(tmp_path / "a" / "b", resume=False) as folder:
        assert folder.finished(row) is None
        folder.save(row, answer)
        assert folder.finished(row) == json.loads(json.dumps(answer.record))
        assert folder.thumbnail(row).read_bytes() == b"picture"
        folder.save(row, dataclasses.replace(answer, status="crashed", record=None))
        assert folder.finished(row) is None
        assert not folder.thumbnail(row).exists()


def test_a_result_stands_as_long_as_its_inputs_do(done, tmp_path):
    row, answer = done
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, answer)
        assert folder.finished(dataclasses.replace(row, options={**row.options, "seed": 1})) is None
        assert folder.finished(dataclasses.replace(row, start="none")) is None
        assert folder.finished(dataclasses.replace(row, line=99)) is not None
        times, content = row.scan.stat(), row.scan.read_bytes()
        os.utime(row.scan, ns=(1, times.st_mtime_ns + 1))
        assert folder.finished(row) is not None
        # Another scan of the same size and time, as a copy with its times kept leaves it.
        row.scan.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
        os.utime(row.scan, ns=(times.st_atime_ns, times.st_mtime_ns))
        assert folder.finished(row) is None
        row.scan.write_bytes(content)
        assert folder.finished(row) is not None


def test_a_result_stands_as_long_as_the_code_does(done, tmp_path, monkeypatch):
    row, answer = done
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, answer)
        assert folder.finished(row) is not None
        assert folder.outdated == set()
        monkeypatch.setattr("dqreg.registration.batch.resume.code_identity", lambda: "of tomorrow")
        assert folder.finished(row) is None
        assert folder.outdated == {row.name}


@pytest.mark.parametrize("damage", [lambda t: t[:-20], lambda t: "", lambda t: "[]", lambda t: '{"batch": 1}',
                                    lambda t: t.replace('"rms"', '"rmss"'), lambda t: "\0" * 100,
                                    lambda t: re.sub(r'"seconds": [^,}]*', '"seconds": "long"', t),
                                    lambda t: re.sub(r'"rms": [^,}]*', '"rms": "0.1"', t)])  # fmt: skip
def test_a_damaged_result_is_none(done, tmp_path, damage):
    row, answer = done
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, answer)
        path = folder.result(row)
        path.write_text(damage(path.read_text()))
        assert folder.finished(row) is None


def test_a_folder_with_results_is_refused_in_words_unless_resumed(done, tmp_path):
    row, answer = done
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, answer)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=r"holds a result already; add --resume"), open_folder(tmp_path, resume=False):
        pass
    assert sorted(tmp_path.rglob("*")) == before
    with open_folder(tmp_path, resume=True) as folder:
        assert folder.finished(row) is not None


def test_two_batches_never_share_a_folder(tmp_path):
    held, second = open_folder(tmp_path, resume=False), open_folder(tmp_path, resume=True)
    with held, pytest.raises(InputError, match="another dqreg batch"), second:
        pass
    with open_folder(tmp_path, resume=True):
        pass


def test_what_a_kill_left_half_written_is_swept_up_and_nothing_else(tmp_path):
    for name in ("results", "thumbnails"):
        (tmp_path / name).mkdir()
    mine, other = tmp_path / "results" / ".0123456789abcdef.tmp", tmp_path / "results" / "notes.tmp"
    for path in (mine, other):
        path.write_text("x")
    with open_folder(tmp_path, resume=True):
        assert not mine.exists()
        assert other.exists()


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "f").write_text("x")
    with pytest.raises(InputError, match="it is a file"), open_folder(tmp_path / "f", resume=True):
        pass
    with pytest.raises(InputError, match="cannot write"), open_folder(tmp_path / "f" / "g", resume=False):
        pass


def test_nothing_found_is_saved_as_such(done, tmp_path):
    row, answer = done
    failed = {"level": "failed", "reasons": ["no pose was found"]}
    record = {**answer.record, "verdict": failed, "status": "no correspondences", "inlier_fraction": 0.0}
    none = {"T_target_source": [[None] * 4] * 4, "covariance": [[None] * 6] * 6, "rms": None, "dual_quaternion": None}
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, dataclasses.replace(answer, record={**record, **none}))
        assert folder.finished(row)["rms"] is None


def test_what_stands_beside_the_checked_values_of_a_result_is_not_believed(done, tmp_path):
    row, answer = done
    with open_folder(tmp_path, resume=False) as folder:
        folder.save(row, answer)
        record = json.loads(folder.result(row).read_text())
        folder.result(row).write_text(json.dumps({**record, "dual_quaternion": "none"}))
        assert folder.finished(row)["dual_quaternion"] == record["dual_quaternion"]


def test_a_pipe_in_place_of_a_result_is_none(done, tmp_path):
    with open_folder(tmp_path, resume=False) as folder:
        os.mkfifo(folder.result(done[0]))
        assert folder.finished(done[0]) is None


def test_a_result_that_cannot_be_saved_is_an_error_of_its_row(done, tmp_path):
    row, answer = done
    long = dataclasses.replace(row, name="x" * 300)
    with open_folder(tmp_path, resume=False) as folder:
        kept = folder.save(long, answer)
        assert (kept.status, kept.record) == ("error", None)
        assert "cannot be saved" in kept.message
        infinite = dataclasses.replace(answer, record={**answer.record, "rms": float("inf")})
        assert folder.save(row, infinite).status == "error"
        assert folder.save(row, answer) is answer


def test_a_scene_is_its_buffers_too(tmp_path):
    tree, body = gltf_tree("a.bin")
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    (tmp_path / "a.bin").write_bytes(body)
    before = digest_of(tmp_path / "a.gltf")
    (tmp_path / "a.bin").write_bytes(body[::-1])
    assert digest_of(tmp_path / "a.gltf") != before
