"""Digests of a scan and its part, by side: they may have one file name, and a glTF part names files of its own."""

import hashlib
import json
from pathlib import Path

from dqreg.files.side_digests import known_digests


def test_scan_and_part_of_one_file_name_are_two(tmp_path: Path) -> None:
    places = {side: tmp_path / side / "a.ply" for side in ("source", "target")}
    for side, place in places.items():
        place.parent.mkdir()
        place.write_bytes(side.encode())
    found = known_digests({side: str(place) for side, place in places.items()})
    assert found == {side: hashlib.sha256(side.encode()).hexdigest() for side in places}


def test_buffers_of_a_part_are_of_it(tmp_path: Path) -> None:
    part = tmp_path / "part.gltf"
    part.write_text(json.dumps({"buffers": [{"uri": "part.bin", "byteLength": 1}]}))
    (tmp_path / "part.bin").write_bytes(b"0")
    before = known_digests({"target": str(part)})
    (tmp_path / "part.bin").write_bytes(b"11")
    assert known_digests({"target": str(part)}) != before


def test_files_that_are_none_or_gone_have_no_digest(tmp_path: Path) -> None:
    (tmp_path / "empty.ply").touch()
    given = ["array of 5 points", None, "a\0b", str(tmp_path), str(tmp_path / "empty.ply"), str(tmp_path / "gone.ply")]
    assert [known_digests({"source": side}) for side in given] == [{}] * len(given)
