"""Where compiled kernels are kept between processes, and what happens where nothing can be kept.

Folders carry a digest of all kernels' sources and of the versions that compile them: after an upgrade nothing old is
found. A file is written whole or not at all, and one that cannot be read counts as absent.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import sys
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
# Packages whose version changes the machine code or the form in which it is kept.
COMPILERS = ("numba", "llvmlite", "numpy")
# File in a folder that says which installation keeps code there.
OWNER = "owner"


@functools.cache
def digest() -> str:
    """Digest of what the machine code depends on beside the processor."""
    found = hashlib.sha256(sys.version.encode())
    for name in COMPILERS:
        found.update(f"{name} {importlib.metadata.version(name)}\n".encode())
    for file in sorted(PACKAGE.rglob("*.py")):
        found.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()[:16]


@functools.cache
def folders() -> tuple[tuple[Path, ...], Path | None]:
    """Folders to read compiled kernels from, in order, and the one to write to; None where there is none."""
    beside = beside_package()
    named = os.environ.get("NUMBA_CACHE_DIR")
    made = [beside] if beside.is_dir() else []
    asked = [Path(named) / _name()] if named else list(dict.fromkeys([*made, *_of_user(), beside]))
    for folder in asked:
        if is_writable(folder):
            return tuple(dict.fromkeys([beside, folder])), folder
    last = _temporary()
    warnings.warn(
        f"none of {', '.join(map(str, asked))} can be written, so compiled code is kept "
        + ("in this process alone, and each new one takes seconds longer" if last is None else f"in {last}")
        + "; set NUMBA_CACHE_DIR to a folder that can",
        UserWarning,
        stacklevel=2,
    )
    return (beside,) if last is None else (beside, last), last


def beside_package() -> Path:
    """Folder inside the installed package, read by every user of it."""
    return PACKAGE / "__pycache__" / _name()


def keep_beside_package() -> None:
    """Make that folder, where it can be made: from then on kernels are kept for every user of the package."""
    is_writable(beside_package())
    folders.cache_clear()


def kept() -> list[Path]:
    """Files of kernels that are kept for this version of the package."""
    return [file for folder in folders()[0] for file in sorted(folder.glob("*.code"))]


def claim(folder: Path) -> None:
    """Mark a folder as this installation's own, and remove those that it kept before an upgrade.

    Folders of other installations, and those without a mark, are left alone.
    """
    mine = f"{sys.prefix}\n{PACKAGE}\n"
    with suppress(OSError):
        (folder / OWNER).write_text(mine, encoding="utf-8")
    for other in folder.parent.glob("kernels-*"):
        # Where a mark cannot be read, there is none.
        with suppress(OSError, UnicodeDecodeError):
            if other == folder or other.is_symlink() or (other / OWNER).read_text(encoding="utf-8") != mine:
                continue
            # Nothing else than was written there, and the mark last: what is interrupted is done the next time.
            for file in (*other.glob("*.code*"), other / OWNER):
                file.unlink()
            other.rmdir()


def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _name() -> str:
    return f"kernels-{digest()}"


def _of_user() -> list[Path]:
    try:
        home = Path.home()
    except RuntimeError:
        return []
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or home / ".cache"
    return [Path(base) / "dqreg" / _name()]


def _temporary() -> Path | None:
    # What lies here is run as code: another user's folder of the expected name is refused.
    try:
        owner = os.getuid() if hasattr(os, "getuid") else 0
        base = Path(tempfile.gettempdir()) / f"dqreg-{owner}"
        base.mkdir(mode=0o700, exist_ok=True)
        found = base.lstat()
    except OSError:
        return None
    private = not hasattr(os, "getuid") or (found.st_uid == owner and not found.st_mode & 0o022)
    folder = base / _name()
    return folder if private and not base.is_symlink() and is_writable(folder) else None
