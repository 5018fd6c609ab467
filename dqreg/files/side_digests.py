"""Digests of the two files of a registration: what tells that its result is shown on others."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dqreg.errors import InputError
from dqreg.files.file_digests import digest_of

SIDES = ("source", "target")
# Settings of a result: digests of its files, and of a loaded one what is said where they are others now.
DIGESTS, CHANGED = "sha256", "changed"


def digests_of_sides(sides: Mapping[str, Any]) -> dict[str, str]:
    """Digests of source and target, of those that name a file."""
    named = {name: Path(side) for name in SIDES if isinstance(side := sides.get(name), str | os.PathLike)}
    return {name: str(digest_of(path)[2]) for name, path in named.items() if _is_file(path)}


def known_digests(settings: Mapping[str, Any]) -> dict[str, str]:
    """Digests of the files that were registered, from the settings of the result.

    As they were read where that is known; as they are now where it is not, and where they have changed since and are
    what is shown.
    """
    kept = None if settings.get(CHANGED) else settings.get(DIGESTS)
    kept = kept if isinstance(kept, dict) else {}
    found: dict[str, str] = {}
    for name in SIDES:
        known = isinstance(kept.get(name), str)
        try:
            found |= {name: kept[name]} if known else digests_of_sides({name: settings.get(name)})
        except InputError:  # It may not be read any more, and the result stands.
            continue
    return found


def changed_words(known: Any, sides: Mapping[str, Any]) -> str:
    """That files of source and target are not those whose digests a result holds; "" where they are, or it has none."""
    if not isinstance(known, dict):
        return ""
    found = digests_of_sides({name: sides[name] for name in SIDES if name in known})
    names = [Path(sides[name]).name for name, digest in found.items() if digest != known[name]]
    if not names:
        return ""
    have = "has changed since it was registered" if len(names) == 1 else "have changed since they were registered"
    return f"{' and '.join(names)} {have}: verdict and pose are of what was there then, deviations of what is there now"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except ValueError:  # A null character
        return False
