from __future__ import annotations

import inspect
import re
import warnings
from pathlib import Path

import pytest

import dqreg
from dqreg import inspection, trust

VERSIONS = (Path(__file__).parents[2] / "docs" / "versions.md").read_text(encoding="utf-8")
OLD = sorted(name for name in trust.__all__ if name not in vars(trust))


def test_what_measures_deviations_has_moved() -> None:
    assert sorted(dqreg._MOVED["dqreg.trust"]) == OLD


@pytest.mark.parametrize("name", OLD)
def test_an_old_name_is_the_new_one_and_warns_its_caller(name: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"dqreg\.trust\.{name} is .*use dqreg\.inspection\.{name}$") as told:
        assert getattr(trust, name) is getattr(inspection, name)
    assert [message.filename for message in told] == [__file__]
    with pytest.warns(DeprecationWarning, match=name) as told:
        exec(compile(f"from dqreg.trust import {name}", "theirs.py", "exec"), {})
    assert {message.filename for message in told} == {"theirs.py"}
    (deprecated,) = re.findall(r"Deprecated today: (.*?)\n\n", VERSIONS, re.DOTALL)
    assert f"`{name}`" in deprecated


def test_what_is_no_name_of_the_room_is_none_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(AttributeError, match=r"'dqreg\.trust' has no attribute 'Bandage'"):
            trust.Bandage  # noqa: B018
        assert inspect.getmodule(trust.judge) is not None
