"""What all records of values have in common: they are shown in one line, and their arrays do not change."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

# Numbers of an array that a line shows.
SHOWN = 6


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
        if value.size > SHOWN:
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
            view = value.view()
            view.setflags(write=False)
            object.__setattr__(result, name, view)
