from __future__ import annotations

import pytest

from dqreg.errors import InputError
from dqreg.synth.recipe_keys import build, named


def unfit(size: float = 1.0) -> None:
    raise InputError(f"size and shape do not go together ({size:g})")


def too_steep(tilt_rad: float = 0.0, more: tuple[float, ...] = ()) -> None:
    if more:
        raise InputError.of("must be lengths; got up, got down", name="more", index=1)
    raise InputError.of("must be flatter", name="tilt_rad", given=tilt_rad, unit="rad")


def test_the_key_at_fault_is_the_one_that_the_error_names_and_not_the_first_word_of_its_message() -> None:
    with pytest.raises(InputError, match=r"^recipe: part: size and shape do not go together \(2\)$"):
        build(unfit, "part", {"size": 2})
    with pytest.raises(InputError, match=r"^recipe: part: size and shape"), named("part", ["size"]):
        unfit()


def test_an_angle_is_given_as_it_stands_in_the_recipe() -> None:
    with pytest.raises(InputError, match=r"^recipe: part.tilt_deg must be flatter; got 80 degrees$"):
        build(too_steep, "part", {"tilt_deg": 80})
    with pytest.raises(InputError, match=r"^recipe: part.more\[1\] must be lengths; got up, got down$"):
        build(too_steep, "part", {"more": [1, 2], "tilt_deg": 80})


def test_a_name_that_is_no_key_of_the_table_is_kept_in_the_message() -> None:
    with (
        pytest.raises(InputError, match=r"^recipe: scan: tilt_rad must be flatter; got 0.0 rad$"),
        named("scan", ["x"]),
    ):
        too_steep()
