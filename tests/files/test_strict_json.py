from __future__ import annotations

import dataclasses
import json
import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.strict_json import plain, record_from


@dataclasses.dataclass(frozen=True)
class Step:
    number: int
    rms: float = 0.0


@dataclasses.dataclass(frozen=True)
class Everything:
    level: Literal["good", "bad"]
    steps: tuple[Step, ...]
    pairs: list[tuple[int, float]]
    seconds: dict[str, float]
    value: str | float | None
    found: bool | None
    anything: Any


@dataclasses.dataclass(frozen=True, eq=False)
class Posed:
    pose: FloatArray


NUMBERS = st.floats() | st.integers(-(2**60), 2**60)
STEPS = st.builds(Step, st.integers(), st.floats())
RECORDS = st.builds(
    Everything,
    st.sampled_from(["good", "bad"]),
    st.lists(STEPS, max_size=3).map(tuple),
    st.lists(st.tuples(st.integers(), st.floats()), max_size=3),
    st.dictionaries(st.text(), st.floats(), max_size=3),
    st.none() | st.text() | st.floats(allow_nan=False, allow_infinity=False),
    st.none() | st.booleans(),
    st.none() | st.text() | st.lists(st.integers()),
)
JSON = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@given(RECORDS)
def test_a_record_survives_strict_json_but_for_infinities(record: Everything) -> None:
    values = plain(record)
    text = json.dumps(values, allow_nan=False)
    again = record_from(Everything, json.loads(text))
    assert plain(again) == values
    assert type(again.steps) is tuple
    assert all(type(step) is Step for step in again.steps)
    assert all(type(pair) is tuple for pair in again.pairs)


@given(JSON, st.sampled_from([field.name for field in dataclasses.fields(Everything)] + ["other"]))
def test_no_json_whatsoever_is_read_as_something_else(value: Any, key: str) -> None:
    good = plain(Everything("good", (Step(1),), [(1, 2.0)], {"a": 1.0}, None, None, None))
    changed = {**good, key: value}
    try:
        found = plain(record_from(Everything, changed))
    except InputError as error:
        found = str(error)
    assert found == plain(changed) or key in found


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (None, "no Step: expected dict, got None"),
        ({}, "number"),
        ({"number": True}, "number: expected int, got True"),
        ({"number": None}, "number: expected int, got None"),
        ({"number": 1, "rms": "0"}, "rms: expected a number, got '0'"),
        ({"number": 1, "rms": False}, "rms: expected a number"),
        ({"number": 1, "rms": 10**400}, "rms: int too large"),
        ({"number": 1, "colour": 1}, "unknown field 'colour'"),
    ],
)
def test_what_does_not_fit_is_named(values: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        record_from(Step, values)


def test_a_check_reads_its_field_at_every_depth() -> None:
    values = {"level": "good", "steps": [{"number": 1, "rms": None}], "pairs": [], "seconds": {}}
    values |= {"value": None, "found": None, "anything": None}
    found = record_from(Everything, values, {"rms": lambda rms: math.inf if rms is None else rms})
    assert found.steps[0].rms == math.inf


def test_missing_numbers_of_an_array_are_nan() -> None:
    pose = record_from(Posed, plain(Posed(np.array([[1.0, np.nan], [np.inf, 2.0]])))).pose
    np.testing.assert_array_equal(pose, [[1.0, np.nan], [np.nan, 2.0]])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float64(0.1), 0.1), (np.int32(3), 3), (np.bool_(True), True), (np.nan, None), (-np.inf, None),
        (np.arange(3), [0, 1, 2]), ({1: {2}}, {"1": [2]}),
    ],
)  # fmt: skip
def test_plain_values_are_pythons_own(value: Any, expected: Any) -> None:
    assert plain(value) == expected
    assert type(plain(value)) is type(expected)
