"""Named errors of dqreg; each message says what was given, what was expected and what to do."""

from __future__ import annotations

import importlib
import sys
import warnings

# Every type checker takes this name for true; the root imports this file, and `typing` would be most of what it costs.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import ModuleType
    from typing import Any, Final, Self

# No value was given: None is one.
NOTHING: Final = object()
# (room, name): what finds a public name that lives in a room above now; the root of the package fills it.
MOVED: dict[tuple[str, str], Callable[[str, str], object]] = {}


class DqregError(Exception):
    """Base of every error that dqreg raises on purpose."""


class InputError(DqregError, ValueError):
    """An argument or a file does not hold what the call needs."""

    # Of one argument that is at fault: what is wrong with it, its name, which of its items, what it was, in which unit.
    message: str = ""
    name: str | None = None
    index: int | None = None
    given: object = NOTHING
    unit: str = ""

    @classmethod
    def of(cls, message: str, *, name: str, index: int | None = None, given: object = NOTHING, unit: str = "") -> Self:
        """The error of one argument: its name, what is wrong with it, and what it was."""
        at = f"[{index}]" if index is not None else ""
        end = "" if given is NOTHING else f"; got {given!r:.80}" + (f" {unit}" if unit else "")
        found = cls(f"{name}{at} {message}{end}")
        found.message, found.name, found.index, found.given, found.unit = message, name, index, given, unit
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process gets the words: what was given may be of any size and kind.
        return type(self), self.args


class UnitsError(InputError):
    """Lengths of source and target look as if they were in different units."""


class DegenerateGeometryError(DqregError, ValueError):
    """The matches leave part of the pose undetermined (for example: all points on one line)."""


class MissingDependencyError(DqregError, ImportError):
    """A package or a system library is absent; the message holds the command that brings it."""


def load_package(module: str, distribution: str, user: str = "this engine") -> ModuleType:
    """A module of an optional package; where it cannot be loaded, the error holds the command that brings it."""
    try:
        return importlib.import_module(module)
    except Exception as error:
        # A wheel that does not fit the system fails in its own ways, not only with an ImportError.
        name = module.partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == name:
            message = f"{user} needs {distribution}; run: pip install {distribution}"
        else:
            message = f"{distribution} cannot load: {error}; run: pip install --force-reinstall {distribution}"
        raise MissingDependencyError(message) from error


def moved_name(room: str, name: str) -> object:
    """What a room was asked for that is not there: a name that has moved; else it is an `AttributeError`."""
    if (room, name) not in MOVED:
        raise AttributeError(f"module {room!r} has no attribute {name!r}")
    return MOVED[room, name](room, name)


def warn_of_old_name(old: str, new: str, what: str = "name") -> None:
    """Warn whoever called this package; Python shows it where that is the user's own program."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "dqreg":
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{old} is the old {what} of {new}; use {new}", DeprecationWarning, stacklevel=level)


# Share of letters that a typing error leaves in their order: "diamter" is near diameter, "flatness" not straightness.
TYPED_SHARE = 0.7


def did_you_mean(word: str, known: Iterable[str], prefix: str = "") -> str:
    """The end of a message about a word that is not known: the nearest one that is, or nothing.

    >>> did_you_mean("nose", ["noise", "points"]), did_you_mean("x", ["noise"])
    ('; did you mean noise?', '')
    """
    found = nearest(word, known, like=TYPED_SHARE)
    return f"; did you mean {prefix}{found[0]}?" if found else ""


def printable(text: str) -> str:
    r"""Text for a terminal: control characters, and what turns the order of letters, as escapes.

    >>> printable("a\x1b[2J.ply"), printable("große µ.ply")
    ('a\\x1b[2J.ply', 'große µ.ply')
    """
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def nearest(word: str, known: Iterable[str], count: int = 1, like: float = 0.6) -> list[str]:
    """The known words that are most like a word, if any are."""
    import difflib

    return difflib.get_close_matches(word.lower(), list(known), n=count, cutoff=like)
