"""Arguments that have a new name: the old one is still taken, with a warning."""

from __future__ import annotations

import sys
import warnings
from typing import Any

from dqreg.errors import InputError


def renamed(old: str, old_value: Any, new: str, new_value: Any, default: Any) -> Any:
    """Value of an argument that may come under its old name, where None is none."""
    if old_value is None:
        return new_value
    if new_value != default:
        raise InputError(f"{old} is the old name of {new}; give {new} alone, got {new_value!r} and {old_value!r}")
    warn_of_old_name(old, new)
    return old_value


def warn_of_old_name(old: str, new: str) -> None:
    """Warn whoever called this package; Python shows it where that is the user's own program."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "dqreg":
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{old} is the old name of {new}; use {new}", DeprecationWarning, stacklevel=level)
