"""The trust sweep: many tasks of each kind in worker processes, kept as JSON lines, resumable."""

from __future__ import annotations

import dataclasses
import os
import queue
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from dqreg.compare.environment import session
from dqreg.compare.store import JsonLines
from dqreg.compare.trust.kinds import KINDS, kinds_named
from dqreg.compare.trust.task import Kind
from dqreg.compare.trust.trial import Trial, trial
from dqreg.errors import InputError
from dqreg.files.code_identity import code_identity
from dqreg.files.strict_json import plain, record_from
from dqreg.registration.batch.watch import Failure
from dqreg.registration.batch.worker import Worker
from dqreg.report.work_bar import TimeLeft

FORMAT = "dqreg trust sweep 1"
# Time of the processor for one task, of which a loaded machine takes nothing away; time on the clock, for one that
# hangs without working.
CPU_SECONDS, TIMEOUT_SECONDS = 120.0, 3600.0
# Tasks after which a worker is replaced.
TASKS_PER_WORKER = 500


@dataclasses.dataclass(frozen=True)
class TrustSweep:
    """All trials of a sweep."""

    trials: tuple[Trial, ...]  # By kind and seed
    kinds: tuple[Kind, ...]
    seeds: tuple[int, int]  # First, and how many
    sessions: tuple[dict[str, Any], ...]  # Machine, versions and code of each session that made trials


@dataclasses.dataclass(frozen=True)
class TrustProgress:
    """How far a sweep is."""

    done: int
    total: int
    seconds_left: float
    trial: Trial | None = None  # The last one that ended


def trust_sweep(
    kinds: Iterable[str] = (),
    *,
    seeds: int = 10,
    first_seed: int = 0,
    workers: int = 2,
    out: str | os.PathLike[str] | None = None,
    observe: Callable[[TrustProgress], None] | None = None,
) -> TrustSweep:
    """Carry out the tasks of all kinds, or of those named, for a range of seeds."""
    if seeds < 1 or first_seed < 0 or workers < 1:
        raise InputError(
            f"seeds and workers must be above 0, first_seed 0 or more; got {seeds}, {workers}, {first_seed}"
        )
    chosen = kinds_named(kinds)
    file = JsonLines(out, FORMAT)
    sessions, found = _known(file, code := code_identity())
    # Seed by seed, so that a sweep that is stopped early has something of every kind.
    wanted = [(kind, seed) for seed in range(first_seed, first_seed + seeds) for kind in chosen]
    jobs = [(kind, seed) for kind, seed in wanted if (kind.name, seed) not in found]
    if jobs:
        begun = {**session((), 1), "code": code}
        sessions.append(begun)
        file.begin(begun)
        _work(jobs, len(wanted), min(workers, len(jobs)), file, found, observe or (lambda _: None))
    trials = tuple(found[kind.name, seed] for kind in chosen for seed in range(first_seed, first_seed + seeds))
    return TrustSweep(trials, tuple(chosen), (first_seed, seeds), tuple(sessions))


def _known(file: JsonLines, code: str) -> tuple[list[dict[str, Any]], dict[tuple[str, int], Trial]]:
    """Sessions of a file that this code and these versions made, and their trials: another dqreg judges otherwise."""
    sessions, found, is_own = [], {}, False
    for line in file.lines:
        if "format" in line:
            is_own = line.get("code") == code
            if is_own:
                sessions.append({key: value for key, value in line.items() if key != "format"})
        elif is_own:
            one = record_from(Trial, line)
            found[one.kind, one.seed] = one
    return sessions, found


def _work(
    jobs: list[tuple[Kind, int]],
    total: int,
    workers: int,
    file: JsonLines,
    found: dict[tuple[str, int], Trial],
    observe: Callable[[TrustProgress], None],
) -> None:
    """Hand the jobs to worker processes, one thread each; a job that fails is a trial too."""
    todo: queue.SimpleQueue[tuple[Kind, int]] = queue.SimpleQueue()
    for job in jobs:
        todo.put(job)
    done: queue.SimpleQueue[tuple[Trial, float] | BaseException | None] = queue.SimpleQueue()
    processes = [Worker(1, most=TASKS_PER_WORKER) for _ in range(workers)]
    threads = [threading.Thread(target=_serve, args=(one, todo, done), daemon=True) for one in processes]
    left = TimeLeft((kind.name, 1.0 / workers) for kind, _ in jobs)
    observe(TrustProgress(total - len(jobs), total, left.seconds))
    try:
        for thread in threads:
            thread.start()
        for count in range(total - len(jobs) + 1, total + 1):
            answer = done.get()
            if isinstance(answer, BaseException):
                raise answer
            assert answer is not None
            one, seconds = answer
            file.append([plain(one)])
            found[one.kind, one.seed] = one
            left.done(one.kind, 1.0 / workers, seconds / workers)
            observe(TrustProgress(count, total, left.seconds, one))
    finally:
        for process in processes:
            process.close()


def _serve(worker: Worker, todo: queue.SimpleQueue[tuple[Kind, int]], done: queue.SimpleQueue[Any]) -> None:
    """Work through the jobs with one process."""
    while True:
        try:
            kind, seed = todo.get_nowait()
        except queue.Empty:
            return
        began = time.monotonic()
        try:
            answer = worker.call(partial(trial_of, kind.name, seed), TIMEOUT_SECONDS, cpu=CPU_SECONDS)
        except BaseException as error:
            done.put(error)
            return
        if worker.closed:
            return
        if isinstance(answer, Failure):
            words, seconds = answer.message, time.monotonic() - began
            answer = Trial(kind.name, seed, kind.good, "error", False, float("nan"), (), words, 0, seconds)
        done.put((answer, time.monotonic() - began))


def trial_of(name: str, seed: int) -> Trial:
    """The trial of a kind's name: what a worker process is told. An unexpected error is a trial with the error."""
    kind = KINDS[name]
    try:
        return trial(kind, seed)
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        return Trial(name, seed, kind.good, "error", False, float("nan"), ("internal_error",), words, 0, 0.0)
