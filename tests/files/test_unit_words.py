from __future__ import annotations

from pathlib import Path

import pytest

from dqreg.files import read_geometry, write_cloud
from dqreg.files.units import METRES, UNIT_WORDS, unit_of_comment


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("units mm", "mm"),
        ("Unit: mm", "mm"),
        ("UNITS=INCH", "inch"),
        ("Model units = millimeters", "mm"),
        ("file units : metres", "m"),
        ("length_unit feet", "ft"),
        ("units", None),
        ("unit normals", None),
        ("units of the scanner: m", None),
        ("deviation in mm", None),
        ("units parsec", None),
    ],
)
def test_a_comment_states_a_unit_or_nothing(comment: str, unit: str | None) -> None:
    assert unit_of_comment(comment) == unit


def test_every_word_is_a_known_unit() -> None:
    assert set(UNIT_WORDS.values()) <= set(METRES)


@pytest.mark.parametrize(
    ("comments", "unit"),
    [(["units mm"], "mm"), (["units mm", "units mm"], "mm"), (["units mm", "units m"], None), (["by hand"], None)],
)
def test_a_ply_cloud_carries_the_unit_of_its_comment(tmp_path: Path, comments: list[str], unit: str | None) -> None:
    write_cloud(tmp_path / "a.ply", [[0.0, 0, 0]], comments=comments)
    assert read_geometry(tmp_path / "a.ply").units == unit


@pytest.mark.parametrize(("head", "unit"), [("# exported\n# Units: cm\n", "cm"), ("", None), ("# m\n", None)])
def test_an_obj_mesh_carries_the_unit_of_its_comment(tmp_path: Path, head: str, unit: str | None) -> None:
    (tmp_path / "a.obj").write_text(head + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n# units: ft\n")
    assert read_geometry(tmp_path / "a.obj").units == unit
