"""Checks of a part's dimensions that several parts share."""

from __future__ import annotations

import itertools
from typing import Any

from dqreg.errors import InputError

# More facets than this in one round are a slip of the pen, not a part.
MOST = 2_000


def require_count(name: str, value: Any, least: int, *, most: int = MOST, multiple: int = 1) -> None:
    """Raise unless a count is a whole number within reason.

    >>> require_count("teeth", 18, 6)
    """
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not whole or not least <= value <= most or value % multiple:
        of = f", a multiple of {multiple}" if multiple > 1 else ""
        raise InputError(f"{name} must be a whole number from {least} to {most}{of}; got {value!r}")


def require_order(**lengths: float) -> None:
    """Raise unless each length is smaller than the next.

    >>> require_order(bore_diameter=1.0, hub_diameter=2.0)
    """
    names = list(lengths)
    for small, large in itertools.pairwise(names):
        if not lengths[small] < lengths[large]:
            raise InputError(f"{small} ({lengths[small]:g}) must be smaller than {large} ({lengths[large]:g})")
