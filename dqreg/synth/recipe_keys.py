"""Checked access to the keys of a recipe; every error names the key as it stands in the file."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from dqreg._numbers import is_number, is_whole
from dqreg.errors import NOTHING, InputError, did_you_mean


def require_known(table: Mapping[str, Any], known: Iterable[str], prefix: str) -> None:
    """Raise if a table holds a key that means nothing."""
    known = list(known)
    for key in table:
        if key not in known:
            hint = did_you_mean(key, known, prefix) or f"; known here: {', '.join(known)}"
            raise InputError(f"recipe: {prefix}{key} is not known{hint}")


def get_table(data: Mapping[str, Any], name: str, known: Iterable[str] | None) -> dict[str, Any]:
    """Return one table of the recipe."""
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"recipe: {name} must be a table, [{name}]; got {table!r}")
    if known is not None:
        require_known(table, known, f"{name}.")
    return dict(table)


def get_number(table: Mapping[str, Any], name: str, default: float, *, most: float = np.inf) -> float:
    """Return a number that is not negative."""
    value = table.get(name.rpartition(".")[2], default)
    if not is_number(value) or not 0.0 <= value < np.inf:
        raise InputError(f"recipe: {name} must be a number that is not negative; got {value!r}")
    if value > most:
        raise InputError(f"recipe: {name} must be at most {most:g}; got {value!r}")
    return float(value)


def get_text(table: Mapping[str, Any], name: str, default: str, choices: Iterable[str] = ()) -> str:
    """Return a text, one of a few if these are given."""
    value, choices = table.get(name.rpartition(".")[2], default), list(choices)
    if not isinstance(value, str) or not value or (choices and value not in choices):
        expected = f"one of {', '.join(choices)}" if choices else "a text"
        raise InputError(f"recipe: {name} must be {expected}; got {value!r}")
    return value


def check_name(value: Any) -> str:
    """Return the name of a case, which can be the name of its folder."""
    if not isinstance(value, str) or not re.fullmatch(r"\w[\w.-]{0,99}", value):
        raise InputError(
            f"recipe: name must be letters, digits, '_', '-' and '.', at most 100, as for a folder; got {value!r}"
        )
    return value


def check_seed(value: Any) -> int:
    """Return a seed, a whole number that is not negative."""
    if not is_whole(value) or value < 0:
        given = "it is missing" if value is None else f"got {value!r}"
        raise InputError(f"recipe: seed must be a whole number that is not negative; {given}")
    return int(value)


Made = TypeVar("Made")


def build(kind: Callable[..., Made], name: str, table: Mapping[str, Any]) -> Made:
    """Make an object from a table, angles turned from degrees to radians."""
    values = keywords_of(kind, name, table)
    try:
        return kind(**values)
    except InputError as error:
        raise _in_recipe(error, name, inspect.signature(kind).parameters, table) from error
    except (TypeError, ValueError) as error:
        raise InputError(f"recipe: a value in [{name}] cannot be used: {error}; given: {dict(table)}") from error


def keywords_of(kind: Callable[..., Any], name: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Make keywords for a callable from a table, angles turned from degrees to radians."""
    keywords = inspect.signature(kind).parameters
    require_known(table, [_in_degrees(key) for key in keywords], f"{name}.")
    values = {key: table[_in_degrees(key)] for key in keywords if _in_degrees(key) in table}
    for key in values:
        if key.endswith("_rad"):
            values[key] = _radians(table, f"{name}.{_in_degrees(key)}")
    return values


@contextmanager
def named(name: str, keys: Iterable[str]) -> Iterator[None]:
    """Errors of what a table made name the key at fault as it stands in the recipe."""
    try:
        yield
    except InputError as error:
        raise _in_recipe(error, name, keys, {}) from error


def _in_recipe(error: InputError, name: str, keys: Iterable[str], table: Mapping[str, Any]) -> InputError:
    """The error of an argument as one of a key of the recipe, an angle in degrees as it stands there."""
    if error.name is None or error.name not in keys:
        return InputError(f"recipe: {name}: {error}")
    key, given, unit = _in_degrees(error.name), error.given, error.unit
    if key.endswith("_deg") and key in table and given is not NOTHING:
        given, unit = table[key], "degrees"
    return InputError.of(error.message, name=f"recipe: {name}.{key}", index=error.index, given=given, unit=unit)


def _in_degrees(key: str) -> str:
    return key.removesuffix("_rad") + "_deg" if key.endswith("_rad") else key


def _radians(table: Mapping[str, Any], name: str) -> float | tuple[float, ...]:
    """One angle, or a list of them, which may be negative."""
    value = table[name.rpartition(".")[2]]
    if not isinstance(value, list):
        return float(np.deg2rad(float(get_number(table, name, 0.0))))
    if not all(is_number(v) and abs(v) < 1e300 for v in value):
        raise InputError(f"recipe: {name} must be a list of numbers; got {value!r}")
    return tuple(float(np.deg2rad(float(v))) for v in value)
