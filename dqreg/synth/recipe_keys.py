"""Checked access to a recipe's keys; every error names the key as the reader of the file knows it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from dqreg.errors import InputError


def require_known(table: Mapping[str, Any], known: Iterable[str], prefix: str) -> None:
    """Raise if a table holds a key that means nothing.

    >>> require_known({"seed": 1}, ["seed", "units"], "")
    """
    known = list(known)
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(known)}"
            raise InputError(f"recipe: {prefix}{key} is not known; {hint}")


def get_table(data: Mapping[str, Any], name: str, known: Iterable[str] | None) -> dict[str, Any]:
    """Return one table of the recipe.

    >>> get_table({"start": {"offset": 0.1}}, "start", ["offset"])
    {'offset': 0.1}
    """
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"recipe: {name} must be a table, [{name}]; got {table!r}")
    if known is not None:
        require_known(table, known, f"{name}.")
    return dict(table)


def get_number(table: Mapping[str, Any], name: str, default: float, *, most: float = np.inf) -> float:
    """Return a number that is not negative.

    >>> get_number({"offset": 2}, "start.offset", 0.1)
    2.0
    """
    value = table.get(name.rpartition(".")[2], default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < np.inf:
        raise InputError(f"recipe: {name} must be a number that is not negative; got {value!r}")
    if value > most:
        raise InputError(f"recipe: {name} must be at most {most:g}; got {value!r}")
    return float(value)


def get_text(table: Mapping[str, Any], name: str, default: str, choices: Iterable[str] = ()) -> str:
    """Return a text, one of a few if these are given.

    >>> get_text({}, "units", "mm", ["mm", "m"])
    'mm'
    """
    value, choices = table.get(name.rpartition(".")[2], default), list(choices)
    if not isinstance(value, str) or not value or (choices and value not in choices):
        expected = f"one of {', '.join(choices)}" if choices else "a text"
        raise InputError(f"recipe: {name} must be {expected}; got {value!r}")
    return value


def check_name(value: Any) -> str:
    """Return the name of a case, which can be the name of its folder.

    >>> check_name("gear_lidar")
    'gear_lidar'
    """
    if not isinstance(value, str) or not re.fullmatch(r"\w[\w.-]{0,99}", value):
        raise InputError(
            f"recipe: name must be letters, digits, '_', '-' and '.', at most 100, as for a folder; got {value!r}"
        )
    return value


def check_seed(value: Any) -> int:
    """Return a seed, a whole number that is not negative.

    >>> check_seed(7)
    7
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        given = "it is missing" if value is None else f"got {value!r}"
        raise InputError(f"recipe: seed must be a whole number that is not negative; {given}")
    return value
