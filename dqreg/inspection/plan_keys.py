"""Checked access to the entries of a plan file; every error names the entry."""

from __future__ import annotations

from typing import Any

from dqreg.errors import InputError, did_you_mean

# Who a face is: its number of `dqreg faces`, or the face that is nearest to a point.
FaceName = int | tuple[float, float, float]


def face_of(entry: dict[str, Any], where: str) -> FaceName:
    """The face that an entry names."""
    if "face" in entry:
        number = entry["face"]
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            raise InputError(f"{where}: face is a number of `dqreg faces`; got {number!r}")
        return number
    near = entry.get("near")
    if isinstance(near, list) and len(near) == 3 and all(isinstance(x, (int, float)) for x in near):
        return float(near[0]), float(near[1]), float(near[2])
    raise InputError(f"{where}: give face = NUMBER of `dqreg faces`, or near = [x, y, z]; got {near!r}")


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
            raise InputError(f"{where}: {key!r} is not known{did_you_mean(key, known)}")


def require_one_of(value: Any, known: tuple[str, ...] | list[str], where: str) -> None:
    """Raise where a value is none of those known."""
    if value not in known:
        names = ", ".join(known) or "none is given"
        raise InputError(f"{where} must be one of {names}; got {value!r}{did_you_mean(str(value), known)}")


def number_of(entry: dict[str, Any], key: str, where: str) -> float:
    """A finite number."""
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < float("inf"):
        raise InputError(f"{where}: {key} must be a number; got {value!r}")
    return float(value)


def triple_of(entry: dict[str, Any], key: str, where: str) -> tuple[float, float, float]:
    """Three finite numbers."""
    value = entry.get(key)
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{where}: {key} must be three numbers, [x, y, z]; got {value!r:.60}")
    x, y, z = (number_of({key: each}, key, where) for each in value)
    return x, y, z
