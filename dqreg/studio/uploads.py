"""Files that are dropped on the page: into a folder of their own, under a safe name, no larger than there is room."""

from __future__ import annotations

import secrets
import shutil
import unicodedata
from collections.abc import AsyncIterator
from pathlib import Path

from dqreg.errors import InputError, did_you_mean
from dqreg.files.atomic import require_folder
from dqreg.files.formats import FOREIGN, READERS
from dqreg.studio.visit import Side

# Bytes of one file, and what must stay free on the disk.
MAX_FILE_BYTES, MIN_FREE_BYTES = 8 << 30, 1 << 30
MAX_NAME_LETTERS = 150


def safe_name(name: str) -> str:
    r"""The last part of a name, without what a file system or a page could take for more than a letter.

    >>> safe_name("../../etc/a b.ply"), safe_name("C:\\x\\tee.stl")
    ('a b.ply', 'tee.stl')
    """
    last = unicodedata.normalize("NFC", name).replace("\\", "/").rpartition("/")[2]
    clean = "".join(c for c in last if c.isprintable() and c not in '<>:"|?*').strip().lstrip(".")
    ending = Path(clean).suffix.lower()
    stem = Path(clean).stem[: MAX_NAME_LETTERS - len(ending)].rstrip()
    named = bool(stem and ending)
    if not named:
        raise InputError(f"{last or name!r:.60} is no name of a scan or part: expected one that ends in {_known()}")
    if ending not in READERS:
        # Said before gigabytes are sent.
        why = FOREIGN.get(ending, f"not one of {_known()}{did_you_mean(ending, READERS)}")
        raise InputError(f"{clean} cannot be read: {ending} is {why}")
    return f"{stem}{Path(clean).suffix}"


async def receive(folder: Path, which: str, name: str, length: int | None, chunks: AsyncIterator[bytes]) -> Side:
    """Write what is sent, whole or not at all."""
    clean = safe_name(name)
    room = min(MAX_FILE_BYTES, shutil.disk_usage(folder).free - MIN_FREE_BYTES)
    if length is not None and length > room:
        raise InputError(f"{clean} has {_size(length)}; there is room for {_size(max(room, 0))}")
    # A folder for this file alone: a file that names others finds none, and the one before it can be brought back.
    home = require_folder(folder / which / secrets.token_hex(4))
    partial, got = home / ".part", 0
    try:
        with partial.open("wb") as stream:
            async for chunk in chunks:
                got += len(chunk)
                if got > room:
                    raise InputError(f"{clean} has more than {_size(max(room, 0))}, which is the room there is")
                stream.write(chunk)
        if length is not None and got != length:
            raise InputError(f"{clean} came incomplete ({got} of {length} bytes): drop it again")
        partial.rename(home / clean)
    except OSError as error:
        raise InputError(f"{clean} cannot be kept: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
    return Side(clean, f"{which}/{home.name}/{clean}")


def _known() -> str:
    return " ".join(sorted(READERS))


def _size(count: int) -> str:
    return f"{count / 2**30:.1f} GiB" if count >= 1 << 29 else f"{count / 2**20:.0f} MiB"
