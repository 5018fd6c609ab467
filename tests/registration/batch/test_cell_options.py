import inspect

import pytest

import dqreg
from dqreg.errors import InputError
from dqreg.registration.batch.cell_options import NOT_OFFERED, OPTIONS, check_options, option_name, parse_option


def test_every_option_of_register_is_offered_or_said_not_to_be():
    of_register = inspect.signature(dqreg.register).parameters.values()
    keywords = {parameter.name for parameter in of_register if parameter.kind is parameter.KEYWORD_ONLY}
    assert set(OPTIONS) | set(NOT_OFFERED) == keywords
    assert not set(OPTIONS) & set(NOT_OFFERED)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("seed", "3", 3),
        ("effort", "fast", "fast"),
        ("max_distance", "1e-3", 1e-3),
        ("accelerate", "No", False),
        ("scale", "solve", "solve"),
        ("scale", "25.4", 25.4),
        ("viewpoint", "0, 0, 5", [[0.0, 0.0, 5.0]]),
        ("viewpoint", "none", "none"),
        ("viewpoint", "origin", "origin"),
        ("viewpoint", "0 0 5; 1 2 3", [[0.0, 0.0, 5.0], [1.0, 2.0, 3.0]]),
    ],
)
def test_cells_are_read(name, text, value):
    assert parse_option(name, text) == value


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("seed", "3.5", "a whole number"),
        ("max_distance", "inf", "a finite number"),
        ("accelerate", "perhaps", "yes or no"),
        ("scale", "large", "the word solve"),
        ("viewpoint", "0 0", "three numbers"),
        ("viewpoint", "0 0 5;", "three numbers"),
        ("viewpoint", "0 0 nan", "three numbers"),
    ],
)
def test_a_cell_that_cannot_be_read_says_what_was_expected(name, text, expected):
    with pytest.raises(InputError, match=f"{name} must be .*{expected}"):
        parse_option(name, text)


def test_columns_are_spelled_as_people_do():
    assert option_name(" Max-Distance") == "max_distance"
    assert option_name("max angle") == "max_angle_deg"
    assert option_name("observe") is None


def test_options_that_register_would_not_take_are_refused():
    with pytest.raises(InputError, match="'colour'"):
        check_options({"colour": "red"})
    with pytest.raises(InputError, match=r"tolerance is no more: .* convergence"):
        check_options({"tolerance": 1e-3})
