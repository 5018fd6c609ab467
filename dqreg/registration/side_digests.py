"""Digests of the two files of a registration: what tells that its result is shown on others."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.files.file_digests import digest_of

if TYPE_CHECKING:
    from dqreg.registration.result import Registration

SIDES = ("source", "target")
# Settings of a result: digests of its files, and of a loaded one what is said where they are others now.
DIGESTS, CHANGED = "sha256", "changed"


def with_digests(result: Registration, digests: Mapping[str, str]) -> Registration:
    """A result with the digests of its files, as `digests_of_sides` found them before these were read."""
    return dataclasses.replace(result, settings={**result.settings, DIGESTS: dict(digests)})


def compared(result: Registration, sides: Mapping[str, Any]) -> Registration:
    """A loaded result with words for what of its files has changed."""
    words = changed_words(result.settings.get(DIGESTS), sides)
    return dataclasses.replace(result, settings={**result.settings, CHANGED: words}) if words else result


def digests_of_sides(sides: Mapping[str, Any]) -> dict[str, str]:
    """Digests of source and target, of those that name a file."""
    named = {name: Path(side) for name in SIDES if isinstance(side := sides.get(name), str | os.PathLike)}
    return {name: str(digest_of(path)[2]) for name, path in named.items() if path.is_file()}


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
