from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from dqreg._records import read_only, replaced


@dataclasses.dataclass(frozen=True)
class Row:
    name: str
    sizes: tuple[float, ...] = ()
    kept: dict[str, Any] = dataclasses.field(default_factory=dict, init=False)

    @cached_property
    def total(self) -> float:
        return sum(self.sizes)


@dataclasses.dataclass(frozen=True)
class Single(Row):
    more: int = 0


@dataclasses.dataclass(frozen=True)
class Checked:
    name: str

    def __post_init__(self) -> None:
        assert self.name


@dataclasses.dataclass(frozen=True)
class Plain:
    name: str
    size: float = 1.0

    @cached_property
    def twice(self) -> float:
        return 2.0 * self.size


def test_a_record_of_fields_alone_is_copied_and_stays_as_it_was() -> None:
    row = Plain("a")
    found = replaced(row, size=2.0)
    assert (row, found, found.twice) == (Plain("a", 1.0), Plain("a", 2.0), 4.0)
    # What follows from the fields was not asked of the first, and is of the second.
    assert "twice" not in vars(row)
    assert replaced(found, size=3.0).twice == 6.0


@pytest.mark.parametrize("row", [Row("a", (1.0, 2.0)), Single("a", (1.0, 2.0), more=3)])
def test_a_record_is_copied_as_dataclasses_does_it(row: Row) -> None:
    assert row.total == 3.0
    row.kept["here"] = 1
    found = replaced(row, sizes=(4.0,))
    assert found == dataclasses.replace(row, sizes=(4.0,))
    assert type(found) is type(row)
    # Neither what followed from the fields, nor what the record keeps for itself.
    assert found.total == 4.0
    assert found.kept == {}
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.name = "b"  # type: ignore[misc]


def test_a_field_that_there_is_not_is_refused_and_so_is_a_record_that_checks() -> None:
    with pytest.raises(TypeError, match=r"Row has no field size$"):
        replaced(Row("a"), size=1.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="Checked checks its fields"):
        replaced(Checked("a"), name="")


def test_what_is_read_only_is_a_view_of_what_is_not() -> None:
    array = np.zeros(3)
    view = read_only(array)
    array[0] = 1.0
    assert view[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 2.0
