"""The words for degrees of freedom: rx, ry, rz rotate about the axes of a frame, tx, ty, tz translate along them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose, pose_of, require_finite
from dqreg.errors import InputError
from dqreg.rigid import pose

TURNS = ("rx", "ry", "rz")
SHIFTS = ("tx", "ty", "tz")
WORDS = TURNS + SHIFTS
# Words that stand for several.
GROUPS = {"r": TURNS, "t": SHIFTS, "all": WORDS, "none": ()}


def read_words(value: Any) -> tuple[list[str], bool]:
    """Words of a text or of several, and whether they name what is locked instead of what is free.

    >>> read_words(["-rx, -ry"])
    (['rx', 'ry'], True)
    """
    words = _split(value)
    if not words:
        raise InputError('dof names no motion; write "none" to lock all six, or for example "rz tx ty"')
    minus = sum(word.startswith("-") for word in words)
    if 0 < minus < len(words):
        raise InputError(f"dof must name what is free or, with a minus each, what is locked; got {' '.join(words)!r}")
    return [word.removeprefix("-") for word in words], minus > 0


def flags(words: Iterable[str]) -> tuple[bool, ...]:
    """Whether each of the six motions is named."""
    named: set[str] = set()
    for word in _split(words):
        if word not in WORDS and word not in GROUPS:
            raise InputError(f"unknown motion {word!r}; known are {', '.join(WORDS)}, and {', '.join(GROUPS)}")
        named.update(GROUPS.get(word, (word,)))
    return tuple(word in named for word in WORDS)


def _split(words: Any) -> list[str]:
    if not isinstance(words, Iterable):
        raise InputError(f'dof must be words such as "rz tx ty", or a Freedom; got {type(words).__name__}')
    found: list[str] = []
    for word in words:
        if not isinstance(word, str):
            raise InputError(f"motions are named by words such as rz or tx; got {word!r}")
        found += word.replace(",", " ").lower().split()
    return found


def as_frame(value: ArrayLike | None, name: str) -> FloatArray:
    """T_target_frame of a 4x4 matrix, of its origin alone, or of nothing.

    >>> as_frame([1, 2, 3], "frame")[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    if value is None:
        return np.eye(4)
    array = as_float(pose_of(value), name)
    if array.shape == (3,):
        require_finite(array, name)
        return pose.from_parts(np.eye(3), array)
    if array.shape not in ((4, 4), (3, 4)):
        raise InputError(f"{name} must be a 4x4 pose T_target_frame, or its origin, three numbers; got {array.shape}")
    return as_pose(array, name)
