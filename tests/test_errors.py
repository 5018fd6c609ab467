from __future__ import annotations

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
