from __future__ import annotations

from pathlib import Path

import pytest

from dqreg.errors import InputError
from dqreg.files import read_mesh

ROWS = "3 1 0\n0 0 0{0}\n1 0 0{0}\n0 1 0{0}\n3 0 1 2{1}\n"


@pytest.mark.parametrize(
    ("keyword", "beside"), [("OFF", ""), ("COFF", " 255 0 0 255"), ("NOFF", " 0 0 1"), ("CNOFF", " 0 0 1 9 9 9 9")]
)
def test_positions_stand_first_whatever_follows(tmp_path: Path, keyword: str, beside: str) -> None:
    for gap in ("\n", " "):
        (tmp_path / "a.off").write_text("# part\n" + keyword + gap + ROWS.format(beside, " 255 0 0"))
        assert read_mesh(tmp_path / "a.off").vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("4OFF\n" + ROWS.format(" 1", ""), "the keyword 4OFF"),
        ("nOFF\n3\n" + ROWS.format("", ""), "the keyword nOFF"),
        ("OFF BINARY\n", "binary OFF"),
        ("OFF\n3 -1 0\n", "the counts"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "lacks corners"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1\n3 0 1 2\n", "a damaged row"),
    ],
)
def test_another_kind_is_named(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.off").write_text(content)
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.off")
