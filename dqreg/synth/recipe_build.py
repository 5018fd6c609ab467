"""From a table of a recipe to the object that it describes; every error names the key."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from dqreg.errors import InputError
from dqreg.synth.recipe_keys import get_number, require_known

Made = TypeVar("Made")


def build(kind: Callable[..., Made], name: str, table: Mapping[str, Any]) -> Made:
    """Make an object from a table, angles turned from degrees to radians."""
    values = keywords_of(kind, name, table)
    try:
        with named(name, inspect.signature(kind).parameters):
            return kind(**values)
    except InputError as error:
        raise InputError(_as_written(str(error), name, table)) from error
    except (TypeError, ValueError) as error:
        raise InputError(f"recipe: a value in [{name}] cannot be used: {error}; given: {dict(table)}") from error


def keywords_of(kind: Callable[..., Any], name: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Make keywords for a callable from a table, angles turned from degrees to radians.

    >>> keywords_of(lambda width=1.0, turn_rad=0.0: width, "part", {"turn_deg": 180})["turn_rad"] == np.pi
    True
    """
    keywords = inspect.signature(kind).parameters
    require_known(table, [_in_degrees(key) for key in keywords], f"{name}.")
    values = {key: table[_in_degrees(key)] for key in keywords if _in_degrees(key) in table}
    for key in values:
        if key.endswith("_rad"):
            values[key] = _radians(table, f"{name}.{_in_degrees(key)}")
    return values


@contextmanager
def named(name: str, keys: Iterable[str]) -> Iterator[None]:
    """Put the name of a table before the message of an error that begins with one of its keys."""
    try:
        yield
    except InputError as error:
        message = str(error)
        key = message.split(" ")[0].partition("[")[0]
        if message.startswith("recipe: "):
            raise
        if key in set(keys):
            raise InputError(f"recipe: {name}.{_in_degrees(key)}{message.removeprefix(key)}") from error
        raise InputError(f"recipe: {name}: {message}") from error


def _as_written(message: str, name: str, table: Mapping[str, Any]) -> str:
    """Give the angle in degrees, as it stands in the recipe, where a message gives it in radians."""
    for key, value in table.items():
        if key.endswith("_deg") and message.startswith(f"recipe: {name}.{key} "):
            return f"{message.rpartition('; got ')[0]}; got {value!r} degrees"
    return message


def _in_degrees(key: str) -> str:
    return key.removesuffix("_rad") + "_deg" if key.endswith("_rad") else key


def _radians(table: Mapping[str, Any], name: str) -> float | tuple[float, ...]:
    """One angle, or a list of them, which may be negative."""
    value = table[name.rpartition(".")[2]]
    if not isinstance(value, list):
        return float(np.deg2rad(get_number(table, name, 0.0)))
    if not all(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in value):
        raise InputError(f"recipe: {name} must be a list of numbers; got {value!r}")
    return tuple(float(np.deg2rad(v)) for v in value)
