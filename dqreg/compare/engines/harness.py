"""One run of an engine: the task checked, the time measured from raw data to pose, every setting recorded."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.compare.engines.protocol import Engine, EngineOutput, Step, Task
from dqreg.errors import InputError

# Same loop: the iteration cap and not the stopping rule decides.
SAME_LOOP_TOLERANCE = 1e-9


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


class RunClock:
    """Seconds of a run until it is stopped, and how many of them went into the target alone."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self._ended: float | None = None
        self.prepare_seconds = 0.0

    @property
    def seconds(self) -> float:
        """Seconds since the run began, up to its end."""
        return (time.perf_counter() if self._ended is None else self._ended) - self._began

    def stop(self) -> None:
        """End the run, if it has not ended: what an engine does after this is not counted."""
        self._ended = time.perf_counter() if self._ended is None else self._ended

    @contextlib.contextmanager
    def preparing(self) -> Iterator[None]:
        """Count a block as work that a second scan to the same target would not need again."""
        began = self.seconds
        yield
        self.prepare_seconds += self.seconds - began


def no_pose(self_report: str) -> EngineOutput:
    """Output without a pose."""
    return EngineOutput(np.full((4, 4), np.nan), self_report)


def timed(
    engine: Engine,
    task: Task,
    work: Callable[[RunClock, dict[str, Any]], EngineOutput],
    failures: tuple[type[Exception], ...] = (),
) -> EngineOutput:
    """Run an engine's work on a task by the clock, and complete its output with times and settings.

    Packages are imported before this is called: importing is not registering. Nothing else happens ahead of the clock.
    """
    require_fit(engine, task)
    settings: dict[str, Any] = {"setting": task.setting}
    with limited(task.threads) as threads:
        settings["threads"] = threads
        clock = RunClock()
        try:
            output = work(clock, settings)
        except failures as error:
            first_line = (str(error).strip().splitlines() or [""])[0]
            output = no_pose(f"raised {type(error).__name__}: {first_line}")
        clock.stop()
    return dataclasses.replace(
        output,
        T_target_source=np.array(output.T_target_source, dtype=np.float64),
        seconds=clock.seconds,
        prepare_seconds=clock.prepare_seconds,
        settings=settings,
    )


def require_fit(engine: Engine, task: Task) -> None:
    """Raise unless the task has what the engine needs."""
    if task.setting not in engine.settings:
        raise InputError(f"{engine.name} takes part in {' and '.join(engine.settings)} only; got {task.setting!r}")
    if task.start is None and engine.needs_initial_pose:
        raise InputError(f"{engine.name} needs an initial pose; got None. Give task.start, (4, 4)")
    if task.threads < 1:
        raise InputError(f"threads must be 1 or more; got {task.threads}")
    if task.setting == "same-loop":
        needed = ("source_points", "target_points", "max_distance", "max_iterations")
        missing = [name for name in needed if getattr(task, name) is None]
        if missing:
            raise InputError(f"a same-loop task must say {', '.join(needed)}; missing: {', '.join(missing)}")


def initial_pose(task: Task) -> FloatArray:
    """Initial pose of a task; the identity where it has none."""
    return np.eye(4) if task.start is None else np.array(task.start, dtype=np.float64)


def replay(run: Any, start: FloatArray, most: int, end: FloatArray) -> tuple[Step, ...]:
    """Intermediate poses: an ICP run one iteration at a time, up to the pose where the timed run ended."""
    T, steps = start, []
    for number in range(1, most + 1):
        T = np.array(run(T, 1).transformation)
        steps.append(Step(number, np.nan, T))
        if np.allclose(T, end, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(end).max())):
            break
    return tuple(steps)


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
