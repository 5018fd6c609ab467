"""What all records of values have in common: one line shows them, their arrays do not change, and some remember more.

What a record remembers beside its fields is in no constructor, no comparison and no copy by `replace`: what was found
once, or what a later step needs. Under the name of a cached property it stands for what that would find.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import lru_cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    # What mypy checks fields by.
    from dataclasses import replace as replaced

Record = TypeVar("Record")
Value = TypeVar("Value")
Array = TypeVar("Array", bound="np.ndarray[Any, Any]")

__all__ = ["lock", "made_of", "made_once", "one_line", "read_only", "remember", "remembered", "replaced"]

# Numbers of an array that a line shows.
SHOWN_NUMBERS = 6


def one_line(value: Any) -> str:
    """One line that says what a record holds: numbers with four digits, large arrays by their shape.

    >>> one_line(dataclasses.make_dataclass("Row", ["rms", "points"])(1.0 / 3.0, np.zeros((5, 3))))
    'Row(rms=0.3333, points=<5 x 3>)'
    """
    named = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
    names = [field.name for field in named if field.repr] or list(getattr(value, "_fields", ()))
    return f"{type(value).__name__}({', '.join(f'{name}={_brief(getattr(value, name))}' for name in names)})"


def _brief(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return f"{value:.4g}"
    if isinstance(value, np.ndarray):
        if value.size > SHOWN_NUMBERS:
            return f"<{' x '.join(map(str, value.shape))}>"
        return np.array2string(value, precision=4, separator=", ", max_line_width=1000).replace("\n", "")
    if isinstance(value, (tuple, list, dict)) and len(value) > 3:
        return f"<{len(value)} items>"
    text = repr(value)
    return text if "\n" not in text else f"<{type(value).__name__}>"


def lock(result: Any) -> None:
    """Make the arrays of a frozen record read-only: what was checked when it was made stays so.

    The record gets views, so that what the arrays were taken from stays as it is.
    """
    for name, value in vars(result).items():
        if isinstance(value, np.ndarray):
            object.__setattr__(result, name, read_only(value))


def read_only(array: Array) -> Array:
    """A view through which an array cannot be changed."""
    view = array.view()
    view.setflags(write=False)
    return view


def remember(record: Record, **values: object) -> Record:
    """The record itself, which from now on remembers these values."""
    vars(record).update(values)
    return record


def forget(record: object, name: str) -> None:
    """Have a record make anew what it remembers under a name."""
    vars(record).pop(name, None)


def remembered(record: object, name: str, default: Any = None) -> Any:
    """What a record remembers under a name, or a default."""
    return vars(record).get(name, default)


def made_once(record: object, name: str, make: Callable[[], Value]) -> Value:
    """What a record remembers under a name, made the first time it is asked for: threads that meet make the same."""
    known = vars(record)
    if name not in known:
        known[name] = make()
    found: Value = known[name]
    return found


def made_of(kind: type[Record], values: Mapping[str, object]) -> Record:
    """A record of values by name, fields or not, that need no check: its constructor is not asked."""
    return remember(object.__new__(kind), **values)


if not TYPE_CHECKING:

    def replaced(record: Record, **changes: Any) -> Record:
        """`dataclasses.replace` of a record that checks nothing as it is made, in a fifth of the time.

        A frozen one sets each of its fields by a call; here they are taken over together.
        """
        kind, known = type(record), vars(record)
        names, values_of, made = _fields(kind)
        # Where nothing but its fields is known of it, all is taken over at once.
        whole = len(known) == len(names) and not made
        values = known.copy() if whole else dict(zip(names, values_of(known), strict=True))
        values.update(changes)
        if len(values) > len(names):
            raise TypeError(f"{kind.__name__} has no field {', '.join(sorted(set(values) - set(names)))}")
        for name, make in made:
            values[name] = make()
        found = object.__new__(kind)
        object.__setattr__(found, "__dict__", values)
        return found


@lru_cache(maxsize=256)
def _fields(kind: type) -> tuple[tuple[str, ...], Callable[[Any], tuple[Any, ...]], tuple[tuple[str, Any], ...]]:
    """Names of the fields that a record is made of, what takes their values, and the fields that it makes itself."""
    # Asked once a kind, the answer is kept: a copy of what checks itself would pass over its checks, also under -O.
    if hasattr(kind, "__post_init__"):
        raise TypeError(f"{kind.__name__} checks its fields as it is made; dataclasses.replace copies it")
    fields = dataclasses.fields(kind)
    made = tuple((field.name, field.default_factory) for field in fields if not field.init)
    names = tuple(field.name for field in fields if field.init)
    # Of a single name it would give no tuple.
    return names, itemgetter(*names) if len(names) > 1 else lambda known: (known[names[0]],), made
