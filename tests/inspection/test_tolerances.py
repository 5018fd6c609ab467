from __future__ import annotations

import pytest

from dqreg.errors import InputError
from dqreg.inspection.tolerances import Tolerance, tolerance_from


@pytest.mark.parametrize("text", ["0.1", "±0.1", "± 0.1", "+-0.1", "+/-0.1", "+/- 0.1", " 0.1 "])
def test_one_length_is_of_both_sides(text: str) -> None:
    assert tolerance_from(text) == 0.1


@pytest.mark.parametrize(
    "text", ["+0.2/-0.05", "+0.2 / -0.05", "+0.2/\u22120.05", "-0.05 / +0.2", "0.2/-0.05", "\u22120.05/+0.2"]
)
def test_two_lengths_with_signs_are_the_sides(text: str) -> None:
    assert tolerance_from(text) == Tolerance(-0.05, 0.2)


@pytest.mark.parametrize(
    ("text", "low", "high"), [("+0.2/0", 0, 0.2), ("0.2 / 0.0", 0, 0.2), ("0/-0.2", -0.2, 0), ("0.2/+0.1", 0.1, 0.2)]
)
def test_zero_needs_no_sign_and_a_sign_may_be_plus(text: str, low: float, high: float) -> None:
    assert tolerance_from(text) == Tolerance(low, high)


@pytest.mark.parametrize("text", ["0.2/0.05", "+0.2/0.05", "0.05/0.2", "0/0.2"])
def test_a_side_whose_sign_was_forgotten_is_asked_for(text: str) -> None:
    with pytest.raises(InputError, match=r"no sign.*-0\.\d+"):
        tolerance_from(text)


@pytest.mark.parametrize("text", ["±", "±-0.1", "+/-0.1/0.2", "0.1/", "wide"])
def test_what_is_no_tolerance_is_told_what_one_is(text: str) -> None:
    with pytest.raises(InputError, match="neither a length nor two sides"):
        tolerance_from(text)
