"""Digests of files: what tells whether a file has changed since a result was made of it."""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

from dqreg.files.gltf_guards import buffers_of
from dqreg.files.untrusted import require_readable


def digest_of(path: Path) -> list[Any]:
    """Path, size and digest of a file, and of the buffers that a glTF file names."""
    digests, size = [], 0
    for place in (path, *(buffers_of(path) if path.suffix.lower() in (".gltf", ".glb") else ())):
        found = require_readable(place).stat()
        size += found.st_size
        # Only a change brings another of these, so that a part is not read again for each of its scans.
        told = found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
        digests.append(_digest(os.fspath(place), *told))
    return [os.fspath(path), size, "+".join(digests)]


@lru_cache(maxsize=64)
def _digest(path: str, *_: int) -> str:
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
