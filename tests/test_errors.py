from __future__ import annotations

import pickle

import pytest

from dqreg import errors


@pytest.mark.parametrize(
    ("error", "builtin"),
    [
        (errors.InputError, ValueError),
        (errors.UnitsError, ValueError),
        (errors.DegenerateGeometryError, ValueError),
        (errors.MissingDependencyError, ImportError),
    ],
)
def test_each_error_is_ours_and_a_familiar_one(error: type[Exception], builtin: type[Exception]) -> None:
    assert issubclass(error, errors.DqregError)
    assert issubclass(error, builtin)
    assert str(error("said so")) == "said so"


def test_wrong_units_are_wrong_input() -> None:
    assert issubclass(errors.UnitsError, errors.InputError)


def test_every_named_error_has_the_common_base() -> None:
    named = [value for value in vars(errors).values() if isinstance(value, type)]
    assert len(named) >= 5
    assert all(issubclass(value, errors.DqregError) for value in named)


def test_an_error_of_one_argument_carries_its_name_and_value_and_says_them() -> None:
    error = errors.InputError.of("must be above 0", name="size", index=2, given=-1, unit="mm")
    assert (error.name, error.index, error.given, error.unit) == ("size", 2, -1, "mm")
    assert str(error) == "size[2] must be above 0; got -1 mm"
    assert str(errors.InputError.of("must be there", name="size", given=None)) == "size must be there; got None"
    # The words go to another process, whatever was given.
    assert str(pickle.loads(pickle.dumps(errors.UnitsError.of("is none", name="f", given=lambda: 0)))).startswith(
        "f is none; "
    )
