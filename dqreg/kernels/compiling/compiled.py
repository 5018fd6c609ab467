"""The one door to Numba: a decorator that compiles a function when it is first called, and keeps the machine code."""

from __future__ import annotations

import hashlib
import pickle
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import serialize
from numba.core.compiler import CompileResult
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from dqreg.kernels.compiling.cache import claim, folders
from dqreg.kernels.compiling.file_locks import FileLocks
from dqreg.kernels.compiling.second_process import announce, start_if_allowed

Function = TypeVar("Function", bound=Callable[..., Any])
ANNOUNCEMENT = (
    "dqreg: compiling inner loops that were not used on this machine before; it takes up to a minute or two, once\n"
)

# `kernel_compiler` uses what Numba promises to nobody: the first and the last version that it was tried with.
FIRST_TRIED, LAST_TRIED = (0, 60), (0, 68)

# Whether this process has said so, and the folders in which it has looked for what is out of date.
_announced = False
_claimed: set[Path] = set()


def compiled(function: Function) -> Function:
    """The function as machine code, without the GIL and with IEEE arithmetic in the order written."""
    return cast(Function, _dispatcher(function))


def inside_kernels(function: Function) -> Function:
    """The same for a function that kernels alone call: without what Python calls it by, a tenth of the compiling."""
    dispatcher = _dispatcher(function, no_cpython_wrapper=True)
    dispatcher.__class__ = InsideKernels
    return cast(Function, dispatcher)


class InsideKernels(CPUDispatcher):  # type: ignore[misc]
    """A function that cannot be called from Python: there is nothing to call, and Numba does not look."""

    def __call__(self, *_: Any) -> None:
        """Refuse."""
        raise TypeError(f"{self.py_func.__name__} is called by kernels alone; from Python, call its py_func")


def compiler(version: str) -> dict[str, Any]:
    """What Numba of a version is to compile kernels with: its own passes where ours were not tried with it."""
    if not _is_tried(version):
        return {}
    from dqreg.kernels.compiling.kernel_compiler import KernelCompiler

    return {"pipeline_class": KernelCompiler}


def keeping(version: str) -> tuple[Callable[[Any], Any], Callable[..., Any]]:
    """What makes compiled code of a version of Numba one that can be pickled, and what makes code of that again."""
    if not _is_tried(version):
        return CompileResult._reduce, CompileResult._rebuild
    from dqreg.kernels.compiling.kernel_compiler import rebuilt, reduced

    return reduced, rebuilt


def _is_tried(version: str) -> bool:
    return FIRST_TRIED <= tuple(int(n) for n in version.split(".")[:2]) <= LAST_TRIED


def _dispatcher(function: Callable[..., Any], **options: bool) -> Any:
    # A wrapper for callers in C would cost a tenth of the time that compiling takes; looking for expressions of whole
    # arrays, which no kernel has, a twenty-fifth.
    switches = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "no_rewrites": True}
    dispatcher = numba.njit(**switches, **options, **COMPILER)(function)
    dispatcher._cache = KeptCode(f"{function.__module__.rpartition('.')[2]}.{function.__name__}")
    return dispatcher


COMPILER = compiler(numba.__version__)
REDUCE, REBUILD = keeping(numba.__version__)


class CompileClock:
    """Seconds that this process has compiled, or waited for another one to; Numba lets one thread compile at a time."""

    def __init__(self) -> None:
        self.seconds = 0.0
        # The function that is compiled, and since when; what it calls is compiled meanwhile.
        self._outermost: tuple[Path, float] | None = None

    def begin(self, file: Path) -> None:
        """A function has to be compiled."""
        if self._outermost is None:
            self._outermost = file, time.perf_counter()

    def end(self, file: Path) -> None:
        """It is there."""
        if self._outermost is not None and self._outermost[0] == file:
            self.seconds += time.perf_counter() - self._outermost[1]
            self._outermost = None


CLOCK = CompileClock()


class KeptCode:
    """Machine code of one function in files, one for each signature and processor: what Numba asks a cache for."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._locks = FileLocks()

    @property
    def cache_path(self) -> str | None:
        """Folder that is written to."""
        folder = folders()[1]
        return None if folder is None else str(folder)

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Code of a signature; None where it has to be compiled."""
        # All that code that was kept needs. Numba's own `refresh` would import what types are inferred with, a third of
        # a second of each process; where a function has to be compiled, it is done then.
        rtsys.initialize(target_context)
        file = self._file(signature, target_context.codegen())
        if (code := _kept(file, target_context)) is not None:
            return code
        _announce()
        CLOCK.begin(file)
        if self._locks.acquire(folders()[1], file) and (code := _kept(file, target_context)) is not None:
            self._locks.release(file)
            CLOCK.end(file)
            return code
        return None

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep the code of a signature, where that can be done."""
        file = self._file(signature, code.codegen)
        if (folder := folders()[1]) is not None:
            self._save(folder / file, code)
        self._locks.release(file)
        CLOCK.end(file)

    def _save(self, path: Path, code: Any) -> None:
        if path.parent not in _claimed:
            _claimed.add(path.parent)
            claim(path.parent)
        beside = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
        try:
            beside.write_bytes(serialize.dumps(REDUCE(code)))
            beside.replace(path)
        except OSError:
            # A full disk costs the next process time and nobody else anything.
            with suppress(OSError):
                beside.unlink()

    def enable(self) -> None:
        """Do nothing: it is always on."""

    def disable(self) -> None:
        """Do nothing: it is always on."""

    def flush(self) -> None:
        """Do nothing: the folder's name says what its files are good for."""

    def _file(self, signature: Any, codegen: Any) -> Path:
        key = hashlib.sha256(repr((str(signature), codegen.magic_tuple())).encode()).hexdigest()[:16]
        return Path(f"{self._name}-{key}.code")


def _kept(file: Path, target_context: Any) -> Any:
    for folder in folders()[0]:
        # A file that is absent, damaged or from elsewhere is one and the same: the code is compiled anew.
        with suppress(Exception):
            return REBUILD(target_context, *pickle.loads((folder / file).read_bytes()))
    return None


def _announce() -> None:
    global _announced  # noqa: PLW0603
    if _announced:
        return
    _announced = True
    announce(ANNOUNCEMENT)
    start_if_allowed()
