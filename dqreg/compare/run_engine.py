"""Calls of an engine, here or in a worker process: time from outside, memory, and whatever it raises."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import gc
import pickle
import sys
import time
import traceback
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.compare.case import small_copy
from dqreg.compare.engines.protocol import EngineOutput, Task
from dqreg.compare.engines.registry import EngineSpec
from dqreg.compare.environment import machine_memory
from dqreg.registration.batch.watch import Failure
from dqreg.registration.batch.worker import Status, Worker

# Loading and compiling libraries in the first call is not the engine's doing, and is not timed.
WARM_SECONDS = 20.0
# Fraction of the machine's memory that an engine may take.
MEMORY_FRACTION = 0.75
_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
# Engines that have run in this worker process.
_warm: set[str] = set()


@dataclasses.dataclass(frozen=True, eq=False)
class EngineCall:
    """What came of one call."""

    status: Status  # As in `dqreg.compare.records.RunRecord`
    message: str = ""  # What went wrong; "" if nothing
    output: EngineOutput | None = None  # What the engine returned
    wall_seconds: float = float("nan")  # Around the whole call
    peak_memory: float = float("nan")  # Bytes that the process grew by at its highest; NaN if unknown


def isolated_calls(
    worker: Worker, spec: EngineSpec, task: Task, repeats: int, timeout: float, memory: float | None = None
) -> Iterator[EngineCall]:
    """Run an engine in a worker process, and again until it fails."""
    # Unpacked anew for each run, so that no run finds what another left.
    packed = pickle.dumps((spec, task), protocol=pickle.HIGHEST_PROTOCOL)
    memory = MEMORY_FRACTION * machine_memory() if memory is None else memory
    answer: EngineCall | Failure | None
    answer = worker.call(partial(_warm_up_once, spec.name, packed), timeout + WARM_SECONDS, memory)
    for _ in range(repeats):
        if not isinstance(answer, Failure):
            answer = worker.call(partial(call, packed), timeout, memory)
        if isinstance(answer, Failure):
            late = answer.kind == "timeout"
            message = f"no answer within {timeout:g} s" if late else answer.message
            yield EngineCall(answer.kind, message, wall_seconds=timeout if late else float("nan"))
            return
        yield answer
        if answer.status != "ran":
            return


def calls_here(spec: EngineSpec, task: Task, repeats: int) -> Iterator[EngineCall]:
    """Run an engine in this process after a warm-up."""
    warm_up((spec, task))
    for _ in range(repeats):
        yield call((spec, task))


def _warm_up_once(name: str, packed: bytes) -> None:
    if name not in _warm:
        warm_up(packed)
        _warm.add(name)


def warm_up(packed: bytes | tuple[EngineSpec, Task]) -> None:
    """Run an engine on a small copy of the task: libraries load and compile before the clock runs."""
    # What goes wrong here goes wrong in the timed run too, and is recorded there.
    with contextlib.suppress(Exception):
        spec, task = _unpack(packed)
        spec.load().register(small_copy(task))


def call(packed: bytes | tuple[EngineSpec, Task]) -> EngineCall:
    """Run an engine once."""
    origin = ""
    try:
        spec, task = _unpack(packed)
        origin = spec.origin
        engine = spec.load()
        before = _settle()
        began = time.perf_counter()
        answer = engine.register(task)
        seconds = time.perf_counter() - began
        peak = _peak() - before
        return EngineCall("ran", "", _checked(answer, seconds), seconds, peak)
    except MemoryError as error:
        return EngineCall("memory", f"MemoryError {error}".strip())
    except Exception as error:
        return EngineCall("error", f"{type(error).__name__}{_place(error, origin)}: {error}")


def _place(error: Exception, origin: str) -> str:
    """Line of an engine's own file where an error came about."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == origin]
    return f" in {Path(origin).name}, line {lines[-1]}" if lines else ""


def _unpack(packed: bytes | tuple[EngineSpec, Task]) -> tuple[EngineSpec, Task]:
    found: tuple[EngineSpec, Task] = pickle.loads(packed) if isinstance(packed, bytes) else packed
    return found


def _checked(answer: Any, seconds: float) -> EngineOutput:
    # A bare pose will do for an engine of a few lines.
    output = answer if isinstance(answer, EngineOutput) else EngineOutput(answer, seconds=seconds)
    T = _pose(output.T_target_source)
    claimed = output.seconds if 0.0 < output.seconds <= seconds else seconds
    words = output.self_report
    # All NaN says that there is none.
    if not np.isfinite(T).all() and not np.isnan(T).all():
        words = "; ".join(filter(None, (words, "NaN or inf in its pose")))
    return dataclasses.replace(output, T_target_source=T, seconds=claimed, self_report=words)


def _pose(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        T = np.array(value)
    except ValueError:
        T = np.array(None)
    if T.dtype.kind not in "fiu" or T.shape != (4, 4):
        what = f"{T.dtype} {T.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise TypeError(f"register returned {what}; needed: a 4x4 pose or an EngineOutput")
    return T.astype(np.float64)


def _settle() -> float:
    """Give unused memory back and begin a new peak; bytes in use."""
    gc.collect()
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
        with contextlib.suppress(OSError):
            _CLEAR.write_text("5")
    return _field("VmRSS")


def _peak() -> float:
    return _field("VmHWM")


def _field(name: str) -> float:
    """A line of the kernel's account of this process, in bytes; NaN where there is none."""
    try:
        for line in _STATUS.read_text().splitlines():
            if line.startswith(name + ":"):
                return 1024.0 * float(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    return _rusage()


def _rusage() -> float:
    try:
        import resource
    except ImportError:
        return float("nan")
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(used if sys.platform == "darwin" else 1024 * used)
