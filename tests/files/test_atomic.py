from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from dqreg.errors import InputError
from dqreg.files.atomic import is_stream, require_writable, write_atomically

BOTH = [require_writable, lambda path: write_atomically(path, b"new")]


@pytest.mark.parametrize("content", [b"\0\xff\r\n", "öäü\r\n\n", b"", ""])
def test_the_file_holds_exactly_what_was_given(tmp_path: Path, content: bytes | str) -> None:
    write_atomically(tmp_path / "a.json", content)
    expected = content.encode() if isinstance(content, str) else content
    assert (tmp_path / "a.json").read_bytes() == expected
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def test_an_old_file_is_replaced_and_keeps_its_permissions(tmp_path: Path) -> None:
    goal = tmp_path / "a.json"
    goal.write_text("old")
    goal.chmod(0o640)
    write_atomically(str(goal), "new")
    assert goal.read_text() == "new"
    assert goal.stat().st_mode & 0o777 == 0o640


def test_a_new_file_gets_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_atomically(tmp_path / "a.json", "new")
    assert (tmp_path / "a.json").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "there" / "real.json")
    write_atomically(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "there" / "real.json").read_text() == "new"


def test_a_pipe_or_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    # A pipe of our own, never a device of the machine: code that is wrong here would replace that for everyone.
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_atomically(pipe, "through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert pipe.is_fifo()


def test_a_disk_is_never_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    goal = tmp_path / "disk"
    goal.write_text("all files")
    monkeypatch.setattr(Path, "is_block_device", lambda path: path == goal)
    for write in BOTH:
        with pytest.raises(InputError, match="a disk or a part of one, all of which would be lost; name a file"):
            write(goal)
    assert goal.read_text() == "all files"


def test_what_is_written_into_and_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(os.devnull)
    streams = [tmp_path / "pipe", Path(os.devnull), tmp_path / "link"]
    assert all(map(is_stream, streams))
    assert not any(map(is_stream, (tmp_path, tmp_path / "none", Path(__file__), Path(__file__) / "x")))


def test_a_name_as_long_as_the_system_allows(tmp_path: Path) -> None:
    goal = tmp_path / ("n" * 250 + ".json")
    write_atomically(goal, "new")
    assert goal.read_text() == "new"


@pytest.mark.parametrize("stage", ["fsync", "replace"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failure_midway_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, failure: BaseException
) -> None:
    goal = tmp_path / "a.json"
    goal.write_text("old")

    def fail(*_: Any) -> None:
        raise failure

    monkeypatch.setattr(*((os, "fsync", fail) if stage == "fsync" else (Path, "replace", fail)))
    expected = InputError if isinstance(failure, OSError) else KeyboardInterrupt
    with pytest.raises(expected) as caught:
        write_atomically(goal, "new")
    assert goal.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]
    if expected is InputError:
        assert str(caught.value) == f"cannot write {goal}: No space left on device"


@pytest.mark.parametrize("write", BOTH)
def test_what_cannot_be_written_is_refused_in_words(tmp_path: Path, write: Any) -> None:
    (tmp_path / "file").touch()
    for path, message in [
        (tmp_path, "it is a folder; give the name of a file in it"),
        (tmp_path / "gone" / "a.json", "gone does not exist; create it first"),
        (tmp_path / "file" / "a.json", "file is a file, not a folder"),
        (tmp_path / "a\0b", "null character"),
        (3, "a path must be text or a pathlib path; got int"),
    ]:
        with pytest.raises(InputError, match=message):
            write(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("write", BOTH)
def test_missing_permission_is_refused_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Any) -> None:
    (tmp_path / "old.json").write_text("old")
    # The superuser may write everywhere, so the refusal is staged.
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).suffix != ".json")
    with pytest.raises(InputError, match=r"old\.json: the file is write-protected; choose another name"):
        write(tmp_path / "old.json")
    monkeypatch.setattr(os, "access", lambda path, mode: not Path(path).is_dir())
    with pytest.raises(InputError, match="no permission to create files in"):
        write(tmp_path / "new.json")
    assert (tmp_path / "old.json").read_text() == "old"


def test_asking_writes_nothing(tmp_path: Path) -> None:
    assert require_writable(tmp_path / "a.json") == tmp_path / "a.json"
    assert list(tmp_path.iterdir()) == []
