"""Packages of peers: imported when needed, quiet while they run."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import warnings
from collections.abc import Iterator
from types import ModuleType

from dqreg.errors import MissingDependencyError


def load_peer(module: str, distribution: str) -> ModuleType:
    """A peer's module."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        absent = (error.name or "").partition(".")[0] == module.partition(".")[0]
        if absent and isinstance(error, ModuleNotFoundError):
            message = f"this engine needs {distribution}; run: pip install {distribution}"
        else:
            # The peer is there, but something that it needs in its turn is not, or does not fit.
            message = f"{distribution} cannot load: {error}; run: pip install --force-reinstall {distribution}"
        raise MissingDependencyError(message) from error


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Let nothing that a peer prints or warns of reach the terminal, whether it prints from Python or from C++.

    For as long as the block runs, the process's standard output and error go nowhere; they are put back after it, also
    when it raises. Other threads of the process are silent as well for that time.
    """
    with contextlib.suppress(AttributeError, ValueError, OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    kept = {number: os.dup(number) for number in (1, 2)}
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in kept:
            os.dup2(nowhere, number)
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            yield
    finally:
        for number, original in kept.items():
            os.dup2(original, number)
            os.close(original)
        os.close(nowhere)
