"""What counts as a number, or a whole one: NumPy's too, and True is none that anybody means."""

from __future__ import annotations

import numbers
from typing import Any, TypeGuard


def is_number(value: object) -> TypeGuard[Any]:
    """Whether a value is a real number.

    >>> import numpy as np
    >>> is_number(np.float32(0.1)), is_number(np.int64(1)), is_number(True), is_number("1"), is_number(None)
    (True, True, False, False, False)
    """
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def is_whole(value: object) -> TypeGuard[Any]:
    """Whether a value is a whole number.

    >>> import numpy as np
    >>> is_whole(3), is_whole(np.int64(3)), is_whole(True), is_whole(3.0)
    (True, True, False, False)
    """
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)
