"""Results never take the place of what they are made from, nor of one another, nor a name of another format."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from dqreg.errors import InputError


def require_apart(read: Iterable[Path | None], written: Mapping[str, Path | None]) -> None:
    """Refuse, before the work, to write over a file that is read, or two results into one file.

    ``written`` has the names of the options. An initial pose may be replaced by the pose that was found from it, so
    that callers leave it out of ``read``.
    """
    from dqreg.files.atomic import is_stream

    known = [path for path in read if path is not None]
    goals: list[tuple[str, Path]] = []
    for name, goal in written.items():
        if goal is None or is_stream(goal):
            continue
        if any(_same(goal, path) for path in known):
            raise InputError(f"{name} {goal} would write over a file that is read; choose another name")
        other = next((first for first, path in goals if _same(goal, path)), None)
        if other is not None:
            raise InputError(f"{other} and {name} both name {goal}; give each a file of its own")
        goals.append((name, goal))


def require_ending(name: str, goal: Path | None, writes: str, endings: tuple[str, ...]) -> None:
    """Refuse, before the work, an ending that promises another format; a name without one promises none."""
    from dqreg.files.atomic import is_stream

    # A stream has the name that it has.
    if goal is None or not goal.suffix or is_stream(goal):
        return
    if goal.suffix.lower() not in endings:
        raise InputError(
            f"{name} writes {writes}; give a name that ends in {' or '.join(endings)}, not {goal.name!r:.100}"
        )


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        # One of them is not there yet, or has a name that the system cannot look up.
        return os.path.realpath(one) == os.path.realpath(other)
