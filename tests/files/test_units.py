from __future__ import annotations

import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.values import UNITS
from dqreg.errors import UnitsError
from dqreg.files import read_geometry, write_cloud
from dqreg.files.units import METRES, MIXED, RATIOS, UNIT_WORDS, factor, unit_of_comment


@pytest.mark.parametrize(
    ("source", "target", "expected"),
    [
        ("m", "mm", 1e3),
        ("mm", "m", 1e-3),
        ("inch", "mm", 25.4),
        ("ft", "inch", 12.0),
        ("cm", "mm", 10.0),
        ("um", "mm", 1e-3),
    ],
)
def test_the_factors_of_the_definitions(source: str, target: str, expected: float) -> None:
    assert factor(source, target) == expected


def test_every_factor_is_the_exact_ratio_rounded_once() -> None:
    # The yard is 0.9144 m by the agreement of 1959; all else are powers of ten.
    yard = Fraction(9144, 10000)
    assert (METRES["ft"], METRES["inch"]) == (yard / 3, yard / 36)
    for a, b in itertools.product(METRES, repeat=2):
        assert factor(a, b) == float(METRES[a] / METRES[b])
        assert factor(a, b) * factor(b, a) == pytest.approx(1.0, rel=3e-16)


@pytest.mark.parametrize(("source", "target"), [(None, None), ("mm", None), (None, "inch"), ("ft", "ft")])
def test_an_unknown_or_equal_unit_converts_nothing(source: str | None, target: str | None) -> None:
    assert factor(source, target) == 1.0


@pytest.mark.parametrize(("source", "target"), [("MM", None), (None, "parsec"), ("mm", "meter"), ("", "mm")])
def test_a_unit_that_is_not_known_is_named(source: str | None, target: str | None) -> None:
    with pytest.raises(UnitsError, match=r"unknown length unit .* known are .*mm, cm, m, inch, ft"):
        factor(source, target)


@pytest.mark.parametrize(
    ("word", "unit"),
    [("millimetre", "mm"), ("millimeters", "mm"), ("MM", "mm"), ("centimeter", "cm"), ("metres", "m"), ("meter", "m"),
     ("inches", "inch"), ("in", "inch"), ("feet", "ft"), ("foot", "ft"), ("microns", "um")],
)  # fmt: skip
def test_usual_spellings_of_a_unit_get_the_one_that_was_meant(word: str, unit: str) -> None:
    with pytest.raises(UnitsError, match=f"did you mean {unit}\\?$"):
        factor(word, "mm")
    if unit in UNITS.choices:
        assert UNITS.get_invalid_choice_message(word, None).endswith(f"ft; did you mean {unit}?")


def test_confused_units_are_known_ones_with_the_coarser_first() -> None:
    assert all(factor(coarse, fine) > 1.0 for coarse, fine in MIXED)
    assert len(set(MIXED)) == len(MIXED)


def test_the_ratios_of_units_are_those_between_any_two_of_them() -> None:
    lengths = [1.0, 10.0, 1000.0, 25.4, 304.8]  # mm
    expected = {a / b for a in lengths for b in lengths if a >= b}
    np.testing.assert_allclose(RATIOS, sorted(expected), rtol=1e-15)


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
