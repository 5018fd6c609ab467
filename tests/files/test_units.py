from __future__ import annotations

import itertools
from fractions import Fraction

import pytest

from dqreg.errors import UnitsError
from dqreg.files.meshes import UNIT_WORDS as FILE_WORDS
from dqreg.files.units import METRES, factor
from dqreg.geometry.opening import UNIT_WORDS


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


def test_every_unit_that_a_reader_or_adapter_names_is_known() -> None:
    assert set(FILE_WORDS.values()) | set(UNIT_WORDS.values()) <= set(METRES)
