"""One run of an engine: checked, timed from raw data to pose, and written down."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.compare.engines.protocol import Attempt, Engine, Step, Task
from dqreg.errors import InputError, MissingDependencyError


@contextlib.contextmanager
def limited(threads: int) -> Iterator[dict[str, Any]]:
    """Hold Open3D to a number of threads for the length of a block.

    OpenMP and BLAS read their environment when they are loaded, too late to change it here: what it says is recorded.
    Engines whose interface takes a number of threads pass it themselves.
    """
    utility = load_open3d().utility
    force = {"asked": threads, "open3d": None, "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS")}
    # Open3D before 0.20 has no such call; it listened to OMP_NUM_THREADS.
    if not hasattr(utility, "set_max_threads"):
        yield force
        return
    before = utility.get_max_threads()
    utility.set_max_threads(threads)
    try:
        yield {**force, "open3d": utility.get_max_threads()}
    finally:
        utility.set_max_threads(before)


# Poses on the way, worked out by running again; only asked for after the clock has stopped.
Replay = Callable[[], tuple[Step, ...]]


class Clock:
    """Seconds since the run began, and how many of them went into the target alone."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self.prepared = 0.0

    @property
    def seconds(self) -> float:
        """Seconds since the run began."""
        return time.perf_counter() - self._began

    @contextlib.contextmanager
    def preparing(self) -> Iterator[None]:
        """Count a block as work that a second scan to the same target would not need again."""
        began = self.seconds
        yield
        self.prepared += self.seconds - began


@dataclasses.dataclass(frozen=True)
class Found:
    """What the work of an engine came to."""

    T_target_source: FloatArray  # (4, 4): The pose as reported; NaN where nothing was found
    claims: str  # What the engine says of it
    iterations: int | None = None  # Where it tells
    curve: tuple[Step, ...] = ()  # Poses on the way that cost nothing
    replay: Replay | None = None  # How to get poses on the way by a second run


def nothing(claims: str) -> Found:
    """No pose."""
    return Found(np.full((4, 4), np.nan), claims)


def timed(
    engine: Engine,
    task: Task,
    work: Callable[[Clock, dict[str, Any]], Found],
    failures: tuple[type[Exception], ...] = (),
) -> Attempt:
    """Run an engine's work on a task by the clock.

    Packages are imported before this is called: importing is not registering. Nothing else happens ahead of the clock.
    """
    require_fit(engine, task)
    settings: dict[str, Any] = {"setting": task.setting}
    with limited(task.threads) as force:
        settings["threads"] = force
        clock = Clock()
        try:
            found = work(clock, settings)
        except failures as error:
            first_line = (str(error).strip().splitlines() or [""])[0]
            found = nothing(f"raised {type(error).__name__}: {first_line}")
        seconds = clock.seconds
        curve = found.replay() if task.curve and found.replay and not found.curve else found.curve
    return Attempt(
        T_target_source=np.array(found.T_target_source, dtype=np.float64),
        seconds=seconds,
        prepare_seconds=clock.prepared,
        iterations=found.iterations,
        claims=found.claims,
        settings=settings,
        curve=curve,
    )


def require_fit(engine: Engine, task: Task) -> None:
    """Raise unless the task has what the engine needs."""
    if task.setting not in engine.settings:
        raise InputError(f"{engine.name} takes part in {' and '.join(engine.settings)} only; got {task.setting!r}")
    if task.start is None and not engine.from_nothing:
        raise InputError(f"{engine.name} needs a start pose; got None. Give task.start, (4, 4)")
    if task.threads < 1:
        raise InputError(f"threads must be 1 or more; got {task.threads}")
    if task.setting == "same-loop":
        needed = ("source_points", "target_points", "max_distance", "max_iterations")
        missing = [name for name in needed if getattr(task, name) is None]
        if missing:
            raise InputError(f"a same-loop task must say {', '.join(needed)}; missing: {', '.join(missing)}")


def start_of(task: Task) -> FloatArray:
    """The start of a task that has one."""
    return np.eye(4) if task.start is None else np.array(task.start, dtype=np.float64)


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
