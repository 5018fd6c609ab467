"""Whatever stands in a plan, it is carried out or refused by one line that names the entry: never a traceback."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dqreg.errors import DqregError, InputError
from dqreg.inspection import inspect
from dqreg.inspection.plan.characteristics import CharacteristicKind
from dqreg.inspection.plan.file import KEYS, plan_of
from tests.inspection.plan.test_file import FACES, scanned

WORDS = st.sampled_from(
    [*KEYS, *get_args(CharacteristicKind), "A", "B", "best-fit", "datums", "minimax", "tz rx", "mm", "", "x" * 300, "ü"]
)
NUMBERS = st.one_of(
    st.sampled_from([0, -1, 1, 2, 10**400, 0.0, -0.0, 1e308, 1e-308, float("nan"), float("inf"), True]),
    st.integers(-5, 40),
    st.floats(-200.0, 200.0),
)
VALUES = st.recursive(
    st.one_of(WORDS, NUMBERS),
    lambda inner: st.one_of(st.lists(inner, max_size=6), st.dictionaries(WORDS, inner, max_size=4)),
    max_leaves=8,
)
FACE = st.one_of(
    st.fixed_dictionaries({"face": st.integers(0, len(FACES))}),
    st.fixed_dictionaries({"near": st.lists(st.floats(-20.0, 140.0), min_size=3, max_size=3)}),
    st.fixed_dictionaries({"box": st.lists(st.floats(-20.0, 140.0), min_size=6, max_size=6)}),
    st.fixed_dictionaries({"faces": st.lists(st.integers(0, len(FACES)), max_size=3)}),
)
SIDES = st.one_of(
    st.fixed_dictionaries({"tolerance": st.floats(-0.1, 1.0)}),
    st.fixed_dictionaries({"plus": st.floats(-0.1, 1.0), "minus": st.floats(-0.1, 1.0)}),
)


def refusal(call: Callable[[], object], error: type[Exception]) -> str:
    """What is said where a call refuses; empty where it does not. Any other error is one of the test."""
    try:
        call()
    except error as refused:
        return str(refused)
    return ""


def entry(**fields: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """An entry that is nearly right: fields, a face, sides of a tolerance."""
    return st.builds(lambda own, face, sides: {**own, **face, **sides}, st.fixed_dictionaries(fields), FACE, SIDES)


NEARLY = st.fixed_dictionaries(
    {},
    optional={
        "datum": st.lists(st.builds(lambda n, f: {"name": n, **f}, st.sampled_from("ABC"), FACE), max_size=3),
        "characteristic": st.lists(
            entry(kind=st.sampled_from(get_args(CharacteristicKind)), datum=st.sampled_from(["A", "B", ""])), max_size=2
        ),
        "face": st.lists(entry(), max_size=2),
        "alignment": st.sampled_from(["best-fit", "datums"]),
        "tolerance": st.floats(0.0, 3.0),
        "section": st.lists(
            st.fixed_dictionaries(
                {
                    "point": st.lists(st.floats(-20.0, 140.0), min_size=3, max_size=3),
                    "normal": st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
                }
            ),
            max_size=1,
        ),
    },
)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.dictionaries(st.one_of(st.sampled_from(KEYS), WORDS), VALUES, max_size=6))
def test_any_table_is_a_plan_or_one_line(values: dict[str, Any]) -> None:
    words = refusal(lambda: plan_of(values), InputError)
    assert words == "" or (words.startswith("plan") and len(words) < 600)
    assert "\n" not in words


@pytest.fixture(scope="module")
def scan() -> Any:
    return scanned(1, count=2_500)


# Each carried out on a scan: more are a soak.
@pytest.mark.parametrize("examples", [12, pytest.param(600, marks=pytest.mark.soak)])
def test_a_plan_that_is_nearly_right_is_carried_out_or_names_its_entry(scan: Any, examples: int) -> None:
    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
    @given(NEARLY)
    def runs(values: dict[str, Any]) -> None:
        words = refusal(lambda: inspect(scan, plan_of(values)), DqregError)
        assert "\n" not in words

    runs()
