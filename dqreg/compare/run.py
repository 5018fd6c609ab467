"""The comparison itself: every engine on the same tasks, judged, kept, resumable."""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from dqreg.compare.case import Challenge
from dqreg.compare.engines.protocol import Task
from dqreg.compare.entrants import Entrant, check_sendable, entrants
from dqreg.compare.environment import Clock, session
from dqreg.compare.judge import judge, worst_along
from dqreg.compare.plan import Item, Rules, plan
from dqreg.compare.records import Run
from dqreg.compare.run_engine import Outcome, call, isolated_calls, warm_up
from dqreg.compare.store import Store, is_last
from dqreg.compare.sweep import Sweep
from dqreg.errors import InputError
from dqreg.files.strict_json import plain
from dqreg.registration.batch.worker import Worker

NOTHING = [[float("nan")] * 4] * 4


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """All that was measured."""

    runs: tuple[Run, ...]  # Every single run of this comparison
    engines: tuple[str, ...]  # Names of those that took part, in their order
    missing: dict[str, tuple[str, ...]]  # Names of those that could not, with what they need
    sessions: tuple[dict[str, Any], ...]  # Machine, versions and threads of each session that made runs
    title: str  # What was compared


@dataclasses.dataclass(frozen=True)
class Progress:
    """How far a comparison is."""

    # done, total: Work in scan points times runs; what had been done before is counted as done
    done: float
    total: float
    seconds_left: float  # Learned from what was done so far; NaN at first
    words: str  # What is running now
    run: Run | None = None  # The run that has just ended


def compare(
    tasks: Any,
    engines: Iterable[Any] | None = None,
    *,
    rules: Rules | None = None,
    out: str | os.PathLike[str] | None = None,
    observe: Callable[[Progress], None] | None = None,
) -> Comparison:
    """Run engines on tasks and judge them."""
    rules = rules or Rules()
    items, title = plan(tasks, rules)
    field = entrants(engines if engines is not None else _own_engines(tasks))
    if engines is not None:
        # Who is named by the caller takes part everywhere.
        items = [dataclasses.replace(item, barred=frozenset()) for item in items]
    missing = {entrant.name: entrant.missing for entrant in field if entrant.missing}
    able = [entrant for entrant in field if not entrant.missing]
    if not able:
        needs = sorted({need for names in missing.values() for need in names})
        raise InputError(f"no engine can run here; install what they need: pip install {' '.join(needs)}")
    if rules.isolate:
        for entrant in able:
            check_sendable(entrant)
    store = Store(out)
    if _open_jobs(items, able, store):
        store.begin(session([need for entrant in able for need in entrant.needs], rules.threads))
        _work(items, able, store, rules, observe or (lambda _: None))
    keys, names = {item.key for item in items}, tuple(entrant.name for entrant in able)
    runs = tuple(_at_home(run, rules.home) for run in store.runs if run.key in keys and run.engine in names)
    return Comparison(runs, names, missing, tuple(store.sessions), title)


def _own_engines(tasks: Any) -> tuple[str, ...] | None:
    """Engines that sweeps name themselves; None where none does."""
    sweeps = [thing for thing in (tasks if isinstance(tasks, (list, tuple)) else [tasks]) if isinstance(thing, Sweep)]
    return tuple(dict.fromkeys(name for sweep in sweeps for name in sweep.all_engines)) or None


def _open_jobs(items: list[Item], able: list[Entrant], store: Store) -> list[tuple[Item, Entrant, int]]:
    """What is still to be done: task, engine and number of runs."""
    return [
        (item, entrant, item.repeats - store.done(item.key, entrant.name))
        for item in items
        for entrant in able
        if item.takes(entrant) and not store.finished(item.key, entrant.name, item.repeats)
    ]


def _work(
    items: list[Item], able: list[Entrant], store: Store, rules: Rules, observe: Callable[[Progress], None]
) -> None:
    jobs = _open_jobs(items, able, store)
    total = sum(item.weight * item.repeats for item in items for entrant in able if item.takes(entrant))
    done = total - sum(item.weight * count for item, _, count in jobs)
    clock = Clock((entrant.name, item.weight * count) for item, entrant, count in jobs)
    made: tuple[str, Challenge] | None = None
    worker = Worker(rules.threads) if rules.isolate else None
    try:
        for item, entrant, count in jobs:
            words, began = f"{item.words}: {entrant.name}", time.monotonic()
            observe(Progress(done, total, clock.seconds_left, words))
            tried = not _gave_up(item, entrant, store)
            if tried:
                if made is None or made[0] != item.key:
                    made = (item.key, item.make())
                first = store.done(item.key, entrant.name)
                outcomes = _outcomes(worker, entrant, made[1].task, count, rules, curve=item.curve)
                for repeat, outcome in enumerate(outcomes, first):
                    run = _judged(item, made[1], entrant, repeat, outcome)
                    store.add([run])
                    part = done + item.weight * (repeat - first + 1)
                    observe(Progress(part, total, clock.seconds_left, words, run))
                    if is_last(run):
                        break
            done += item.weight * count
            clock.done(entrant.name, item.weight * count, time.monotonic() - began if tried else 0.0)
    finally:
        if worker is not None:
            worker.close()


def _outcomes(
    worker: Worker | None, entrant: Entrant, task: Task, repeats: int, rules: Rules, *, curve: bool
) -> Iterator[Outcome]:
    """Timed runs; the last brings a curve where one is wanted, from a run of its own if need be."""
    timed = _calls(worker, entrant, task, repeats, rules)
    for number, outcome in enumerate(timed, 1):
        if curve and number == repeats and outcome.attempt is not None and not outcome.attempt.curve:
            again = next(_calls(worker, entrant, dataclasses.replace(task, curve=True), 1, rules))
            if again.attempt is not None:
                outcome = dataclasses.replace(
                    outcome, attempt=dataclasses.replace(outcome.attempt, curve=again.attempt.curve)
                )
        yield outcome


def _calls(worker: Worker | None, entrant: Entrant, task: Task, repeats: int, rules: Rules) -> Iterator[Outcome]:
    if worker is not None:
        yield from isolated_calls(worker, entrant, task, repeats, rules.timeout, rules.memory_limit)
        return
    packed = (entrant, task)
    warm_up(packed)
    for _ in range(repeats):
        yield call(packed)


def _at_home(run: Run, home: float) -> Run:
    """The run with its success as today's rules have it: older runs of a file may have been made under others."""
    if run.success is None:
        return run
    return dataclasses.replace(run, success=run.kind == "rigid" and run.worst <= home * run.size)


def _gave_up(item: Item, entrant: Entrant, store: Store) -> bool:
    """Whether an engine ran out of time or memory on a smaller scan of the same row: a larger one is not tried."""
    return item.row is not None and any(
        run.status in ("timeout", "memory")
        for run in store.runs
        if (run.engine, run.axis, run.setting) == (entrant.name, *item.row)
    )


def _judged(item: Item, challenge: Challenge, entrant: Entrant, repeat: int, outcome: Outcome) -> Run:
    attempt, nan = outcome.attempt, float("nan")
    T = NOTHING if attempt is None else attempt.T_target_source
    score = judge(T, challenge.yardstick)
    curve = () if attempt is None else attempt.curve
    worst = worst_along([step.T_target_source for step in curve], challenge.yardstick).tolist()
    return Run(
        key=item.key,
        engine=entrant.name,
        repeat=repeat,
        case=challenge.case,
        axis=challenge.axis,
        value=challenge.value,
        trial=challenge.trial,
        setting=challenge.task.setting,
        from_nothing=challenge.task.start is None,
        points=len(challenge.task.source),
        size=challenge.yardstick.size,
        units=challenge.units,
        status=outcome.status,
        message=outcome.message,
        T_target_source=None if attempt is None else attempt.T_target_source.tolist(),
        seconds=nan if attempt is None else attempt.seconds,
        prepare_seconds=nan if attempt is None else attempt.prepare_seconds,
        wall_seconds=outcome.wall_seconds,
        peak_memory=outcome.peak_memory,
        iterations=None if attempt is None else attempt.iterations,
        claims="" if attempt is None else attempt.claims,
        settings={} if attempt is None else json.loads(json.dumps(plain(attempt.settings), default=str)),
        curve=[(step.iteration, step.seconds, w) for step, w in zip(curve, worst, strict=True)],
        **dataclasses.asdict(score),
    )
