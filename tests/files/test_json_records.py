"""A JSON object from a file that may be anything."""

from pathlib import Path

import pytest

from dqreg.errors import InputError
from dqreg.files.json_records import read_json


def test_a_byte_order_mark_is_no_damage(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(tmp_path / "a.json", "a record") == {"a": 1}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{", "is no readable JSON file: expected a record"),
        (b"[" * 200_000, "is no readable JSON file: expected a record"),
        (b"[1, 2]", "a JSON object; got list"),
        (b"\xff\xfe", "no UTF-8 text"),
        (b"", "an empty file"),
    ],
)
def test_what_is_no_object_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_json(tmp_path / "a.json", "a record")


def test_a_file_that_is_not_there_has_names_near_it(tmp_path: Path) -> None:
    (tmp_path / "visit.json").write_text("{}")
    with pytest.raises(InputError, match=r"perhaps visit\.json"):
        read_json(tmp_path / "visti.json", "a visit")
