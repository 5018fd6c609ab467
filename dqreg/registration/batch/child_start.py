"""How a child process starts: no file of the working folder, whatever its name, is ever taken for a module."""

from __future__ import annotations

import contextlib
import os
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from pathlib import Path

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def safe_environment(threads: int) -> dict[str, str]:
    """Variables of a child: its threads, and safe-path mode, which its own children inherit."""
    return {**{name: str(threads) for name in THREAD_VARIABLES}, "PYTHONSAFEPATH": "1"}


def safe_path(entries: Sequence[str]) -> list[str]:
    """A module search path with the standard library first, so that nothing else can stand in for it."""
    places = list(entries)
    # An empty entry is the working folder. It stays on the path: dqreg itself or an engine may lie in it.
    with contextlib.suppress(FileNotFoundError):
        places = [entry or os.getcwd() for entry in entries]  # noqa: PTH109 - a path is text
    return sorted(places, key=lambda place: not _is_standard(Path(place)))


def _is_standard(place: Path) -> bool:
    folders = {Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")}
    place = place.resolve()
    packed = f"python{sys.version_info.major}{sys.version_info.minor}.zip"
    return place in folders or place.name == packed or (place.name == "lib-dynload" and place.parent in folders)


@contextlib.contextmanager
def safely_started(threads: int) -> Iterator[None]:
    """What `multiprocessing` starts in this block, its resource tracker too, starts so."""
    values = safe_environment(threads)
    variables, entries = {name: os.environ.get(name) for name in values}, list(sys.path)
    os.environ.update(values)
    sys.path[:] = safe_path(entries)
    try:
        yield
    finally:
        sys.path[:] = entries
        for name, value in variables.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
