"""Checks of options that stand alone, for all who take them: each error names the option and what it takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dqreg._arrays import MAX_LENGTH
from dqreg._numbers import is_number, is_whole
from dqreg.errors import InputError, did_you_mean

# What other libraries call what is meant.
ELSEWHERE = {"point-to-plane": "plane", "point-to-point": "dq-points", "gicp": "generalised"}


def require_word(name: str, value: object, words: Sequence[str]) -> None:
    """Raise unless an option is one of the words that it takes."""
    # Only text is looked up: a list has no hash, and would end in an error without a name.
    if not isinstance(value, str) or value not in words:
        meant = did_you_mean(ELSEWHERE.get(str(value), str(value)), words)
        raise InputError(f"unknown {name} {value!r:.60}; known are {', '.join(words)}{meant}")


def require_flag(name: str, value: object) -> None:
    """Raise unless an option is True or False: what counts as true, as text that says no, is not taken for it."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} must be True or False; got {value!r:.60}")


def require_seed(seed: Any) -> None:
    """Raise unless random numbers can begin there."""
    if not is_whole(seed) or seed < 0:
        raise InputError(f"seed must be a whole number, 0 or more; got {seed!r:.60}")


def read_time_limit(seconds: Any) -> float | None:
    """Seconds above 0, or None."""
    if seconds is not None and not (is_number(seconds) and as_float(seconds) > 0.0):
        raise InputError(f"time_limit must be a number of seconds above 0; got {seconds!r:.60}")
    return None if seconds is None else as_float(seconds)


def require_observer(observer: object, name: str) -> None:
    """Raise unless it is a function, or None."""
    if observer is not None and not callable(observer):
        raise InputError(f"{name} must be a function of one record, or None; got {observer!r:.80}")


def as_float(number: Any) -> float:
    """The number as Python's; infinite where it is beyond all of these."""
    try:
        return float(number)
    except OverflowError:
        return math.copysign(math.inf, 1 if number > 0 else -1)


def require_scale(scale: object) -> None:
    """Raise unless lengths can be multiplied with it, or it is to be estimated."""
    # Only text is compared: an array would answer with an array.
    if isinstance(scale, str) and scale == "solve":
        return
    if not is_number(scale) or not 1.0 / MAX_LENGTH < as_float(scale) < MAX_LENGTH:
        raise InputError(
            f'scale must be a number above 0 that source lengths are multiplied with, or "solve"; got {scale!r:.60}'
        )
