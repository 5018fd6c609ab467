"""Checked access to the entries of a plan file; every error names the entry."""

from __future__ import annotations

import sys
from typing import Any

from dqreg._numbers import is_number, is_whole
from dqreg.errors import InputError, did_you_mean

# What names a face: its number of `dqreg faces`, three coordinates that it is nearest to, or the six of a box that it
# lies in.
FaceName = int | tuple[float, ...]
# Keys that do, and the coordinates of each.
NAMES = {"near": 3, "box": 6}
# No part has more.
MOST_FACES = 10**9


def face_of(entry: dict[str, Any], where: str) -> FaceName:
    """The face that an entry names."""
    given = [key for key in ("face", *NAMES) if key in entry]
    if len(given) != 1:
        got = " and ".join(given) or "none of them"
        words = "face = NUMBER of `dqreg faces`, near = [x, y, z] or box = [x, y, z, x, y, z]"
        raise InputError(f"{where}: give {words}; got {got}")
    key = given[0]
    if key == "face":
        number = entry["face"]
        if not is_whole(number) or not 0 <= number < MOST_FACES:
            raise InputError(f"{where}: face is a number of `dqreg faces`; got {number!r:.60}")
        return int(number)
    values, count = entry[key], NAMES[key]
    if not isinstance(values, list) or len(values) != count:
        words = {3: "[x, y, z]", 6: "[x, y, z, x, y, z], two opposite corners"}[count]
        raise InputError(f"{where}: {key} is {words}; got {values!r:.80}")
    return tuple(number_of({key: x}, key, where) for x in values)


def faces_of_list(given: Any, where: str) -> tuple[FaceName, ...]:
    """The faces of a list: numbers, points [x, y, z] that they are nearest to, boxes [x, y, z, x, y, z]."""
    if not isinstance(given, list):
        raise InputError(f"{where}: faces is a list such as [3, 4]; got {given!r:.80}")
    keys = {count: key for key, count in NAMES.items()}
    return tuple(
        face_of({keys.get(len(face), "box"): face} if isinstance(face, list) else {"face": face}, where)
        for face in given
    )


def list_of(values: dict[str, Any], key: str, name: str) -> list[Any]:
    """The tables of a key."""
    found = values.get(key, [])
    if not isinstance(found, list):
        raise InputError(f"{name}: {key} must be written as [[{key}]]")
    return found


def require_known(entry: Any, known: tuple[str, ...], where: str) -> None:
    """Raise where an entry is no table, or holds a key that means nothing."""
    if not isinstance(entry, dict):
        raise InputError(f"{where} must be a table; got {entry!r:.60}")
    for key in entry:
        if key not in known:
            meant = did_you_mean(key[:60], known) or f"; known are {', '.join(known)}"
            raise InputError(f"{where}: {key!r:.60} is not known{meant}")


def require_one_of(value: Any, known: tuple[str, ...] | list[str], where: str) -> None:
    """Raise where a value is none of those known."""
    if value not in known:
        names = ", ".join(known) or "none is given"
        raise InputError(f"{where} must be one of {names}; got {value!r:.60}{did_you_mean(str(value)[:60], known)}")


def number_of(entry: dict[str, Any], key: str, where: str) -> float:
    """A finite number."""
    value = entry[key]
    # Integers of TOML may be longer than any float.
    if not is_number(value) or not abs(value) <= sys.float_info.max:
        raise InputError(f"{where}: {key} must be a number; got {value!r:.60}")
    return float(value)


def triple_of(entry: dict[str, Any], key: str, where: str) -> tuple[float, float, float]:
    """Three finite numbers."""
    value = entry.get(key)
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{where}: {key} must be three numbers, [x, y, z]; got {value!r:.60}")
    x, y, z = (number_of({key: each}, key, where) for each in value)
    return x, y, z
