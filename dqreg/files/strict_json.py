"""Values as strict JSON has them, and typed records read back from them without trust."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from dqreg.errors import InputError

Record = TypeVar("Record")
Checks = Mapping[str, Callable[[Any], Any]]
UNFIT = (TypeError, ValueError, ArithmeticError, KeyError)


def plain(value: Any) -> Any:
    """Lists, numbers and strings of records, arrays and containers; NaN and infinity become None, the rest stays."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, (list, tuple, set)):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return value


def record_from(cls: type[Record], values: Any, checks: Checks | None = None) -> Record:
    """Dataclass of what `plain` made of one: every field by its declared type, None as NaN where a number belongs.

    A check reads the field of its name instead, in records inside too. Anything else than expected is an `InputError`.
    """
    try:
        return cls(**fields_from(cls, values, checks))
    except UNFIT as error:
        raise InputError(f"no {cls.__name__}: {error}") from error


def fields_from(cls: type, values: Any, checks: Checks | None = None) -> dict[str, Any]:
    """Fields of a dataclass by name, each checked as in `record_from`."""
    types = _types(cls)
    return {name: _field(types, name, value, checks or {}) for name, value in _of(dict, values).items()}


def _field(types: dict[str, Any], name: str, value: Any, checks: Checks) -> Any:
    if name not in types:
        raise TypeError(f"unknown field {name!r:.60}")
    try:
        return checks[name](value) if name in checks else _read(types[name], value, checks)
    except UNFIT as error:
        raise ValueError(f"{name}: {error}") from error


@functools.cache
def _types(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


def _read(kind: Any, value: Any, checks: Checks) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if origin in (Union, UnionType):
        return _read_any(inner, value, checks)
    if dataclasses.is_dataclass(kind):
        return record_from(kind, value, checks)  # type: ignore[arg-type]
    if origin is Literal:
        return _require(value in inner, value, f"one of {', '.join(map(repr, inner))}")
    if origin is np.ndarray:
        return np.array(value, dtype=np.float64)  # None becomes NaN
    if origin is dict:
        return {key: _read(inner[1], item, checks) for key, item in _of(dict, value).items()}
    if origin in (list, tuple):
        items = _of(list, value)
        kinds = [inner[0]] * len(items) if origin is list or inner[-1] is Ellipsis else inner
        return origin(_read(each, item, checks) for each, item in zip(kinds, items, strict=True))
    return _number(value) if kind is float else _of(kind, value)


def _read_any(kinds: tuple[Any, ...], value: Any, checks: Checks) -> Any:
    if NoneType in kinds and value is None:
        return None
    for kind in kinds:
        try:
            return _read(kind, value, checks)
        except UNFIT:
            continue
    return _require(False, value, " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds))


def _number(value: Any) -> Any:
    if value is None:
        return math.nan
    _require(isinstance(value, (int, float)) and not isinstance(value, bool), value, "a number")
    float(value)  # an integer beyond float64 ends here
    return value


def _of(kind: type, value: Any) -> Any:
    return _require(isinstance(value, kind) and not (kind is int and isinstance(value, bool)), value, kind.__name__)


def _require(met: bool, value: Any, expected: str) -> Any:
    if not met:
        raise TypeError(f"expected {expected}, got {value!r:.60}")
    return value
