"""What a kept result depends on beside its inputs: the code that made it, and the versions of what that uses."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import sys
from collections.abc import Iterable
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
ALWAYS = ("dqreg", "numpy", "scipy", "numba", "trimesh")


def code_identity(places: tuple[str, ...] = ("",), needs: Iterable[str] = ()) -> str:
    """Digest of Python, of dqreg's sources in some places of the package, and of the versions of distributions.

    The version of dqreg alone would take what an edited one has made.
    """
    found = hashlib.blake2b(sys.version.encode(), digest_size=8)
    for name, version in sorted(installed_versions((*ALWAYS, *needs)).items()):
        found.update(f"{name} {version}\n".encode())
    found.update(_sources(places).encode())
    return found.hexdigest()


def installed_versions(distributions: Iterable[str]) -> dict[str, str]:
    """Versions of those distributions that are installed."""
    found = {}
    for name in dict.fromkeys(distributions):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


@functools.cache
def _sources(places: tuple[str, ...]) -> str:
    """Digest of the sources in some places of the package."""
    found = hashlib.blake2b()
    for place in (PACKAGE / name for name in places):
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            found.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()
