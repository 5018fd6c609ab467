"""The comparison itself: every engine on the same tasks, judged, kept, resumable."""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from dqreg.compare.case import BenchmarkCase
from dqreg.compare.engines.harness import no_pose
from dqreg.compare.engines.protocol import EngineOutput, Task
from dqreg.compare.engines.registry import EngineSpec, engine_specs, missing
from dqreg.compare.environment import session
from dqreg.compare.identity import identity
from dqreg.compare.judge import judge, worst_along
from dqreg.compare.plan import PlannedRun, Protocol, inverted_truths, plan
from dqreg.compare.records import RunRecord
from dqreg.compare.run_engine import EngineCall, calls_here, isolated_calls
from dqreg.compare.store import Store, is_last, kept_words
from dqreg.compare.sweep import Sweep
from dqreg.errors import InputError
from dqreg.files.strict_json import plain
from dqreg.registration.batch.worker import Worker

# Name of the initial pose where engines are named.
START = "initial pose"


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """All that was measured."""

    runs: tuple[RunRecord, ...]  # Every single run of this comparison
    engines: tuple[str, ...]  # Names of those that took part, in their order
    missing: dict[str, tuple[str, ...]]  # Names of those that could not, with what they need
    sessions: tuple[dict[str, Any], ...]  # Machine, versions and threads of each session that made runs
    title: str  # What was compared
    kept: str = ""  # What of it was taken from a file, and made when
    starts: tuple[RunRecord, ...] = ()  # The initial pose of each case, judged as if an engine had returned it
    unfit: dict[str, str] = dataclasses.field(default_factory=dict)  # Engines that take no task of these, and why not
    hints: tuple[str, ...] = ()  # What may be wrong with the tasks


@dataclasses.dataclass(frozen=True)
class ComparisonProgress:
    """How far a comparison is."""

    # done, total: Work in scan points times runs; what had been done before is counted as done
    done: float
    total: float
    seconds_left: float  # Learned from what was done so far; NaN at first
    words: str  # The current run
    run: RunRecord | None = None  # The run that has just ended


def compare(
    tasks: Any,
    engines: Iterable[Any] | None = None,
    *,
    protocol: Protocol | None = None,
    out: str | os.PathLike[str] | None = None,
    observe: Callable[[ComparisonProgress], None] | None = None,
) -> Comparison:
    """Run engines on tasks and judge them."""
    protocol = protocol or Protocol()
    items, title = plan(tasks, protocol)
    specs = engine_specs(engines if engines is not None else _own_engines(tasks))
    if engines is not None:
        # Engines that the caller names take part on every axis.
        items = [dataclasses.replace(item, excluded=frozenset()) for item in items]
    lacking = {spec.name: missing(spec) for spec in specs if missing(spec)}
    able = [dataclasses.replace(spec, identity=identity(spec)) for spec in specs if spec.name not in lacking]
    if not able:
        needs = sorted({need for names in lacking.values() for need in names})
        raise InputError(f"no engine can run here; install what they need: pip install {' '.join(needs)}")
    unfit = {spec.name: why for spec in able if (why := _unfit(spec, items))}
    if len(unfit) == len(able):
        words = "; ".join(f"{name} {why}" for name, why in unfit.items())
        raise InputError(f"no engine fits: {words}. Name another with --engine, or change --start or --setting")
    if protocol.isolate:
        for spec in able:
            spec.require_picklable()
    store = Store(out, protocol.timeout)
    kept = kept_words(store, {item.key for item in items}, able)
    if _open_jobs(items, able, store):
        store.begin(session([need for spec in able for need in spec.needs], protocol.threads))
        _work(items, able, store, protocol, observe or (lambda _: None))
    names, codes = {item.key: item.case for item in items}, {spec.name: spec.identity for spec in able}
    known = (run for run in store.runs if run.key in names and codes.get(run.engine) == run.identity)
    runs, starts = (
        tuple(
            dataclasses.replace(_rejudged(run, protocol.success_threshold), case=names[run.key] or run.case)
            for run in made
        )
        for made in (known, _starts(items))
    )
    hints = inverted_truths(items, runs)
    return Comparison(runs, tuple(codes), lacking, tuple(store.sessions), title, kept, starts, unfit, hints)


def _own_engines(tasks: Any) -> tuple[str, ...] | None:
    """Engines that the sweeps name; None where none does."""
    sweeps = [thing for thing in (tasks if isinstance(tasks, (list, tuple)) else [tasks]) if isinstance(thing, Sweep)]
    return tuple(dict.fromkeys(name for sweep in sweeps for name in sweep.all_engines)) or None


def _unfit(spec: EngineSpec, items: list[PlannedRun]) -> str:
    """Why an engine takes none of the tasks; "" where it takes one."""
    if any(item.takes(spec) for item in items):
        return ""
    if spec.needs_initial_pose and not any(item.has_initial_pose for item in items):
        return "needs an initial pose"
    return f"takes part in {' and '.join(spec.settings)} only"


def _starts(items: list[PlannedRun]) -> list[RunRecord]:
    """Initial poses of the cases, judged; what a sweep's are off is its axis."""
    nobody = EngineSpec(START, (), True, ("manual",), "object")
    made = []
    for item in items:
        if item.case and item.has_initial_pose:
            case = item.make()
            assert case.task.start is not None
            made.append(_judged(item, case, nobody, 0, EngineCall("ran", output=EngineOutput(case.task.start))))
    return made


def _open_jobs(
    items: list[PlannedRun], able: list[EngineSpec], store: Store
) -> list[tuple[PlannedRun, EngineSpec, int]]:
    """What is left to do: planned runs, engine and number of runs."""
    return [
        (item, spec, item.repeats - store.done(item.key, spec))
        for item in items
        for spec in able
        if item.takes(spec) and not store.finished(item.key, spec, item.repeats)
    ]


def _work(
    items: list[PlannedRun],
    able: list[EngineSpec],
    store: Store,
    protocol: Protocol,
    observe: Callable[[ComparisonProgress], None],
) -> None:
    from dqreg.report.work_bar import TimeLeft

    jobs = _open_jobs(items, able, store)
    total = sum(item.weight * item.repeats for item in items for spec in able if item.takes(spec))
    done = total - sum(item.weight * count for item, _, count in jobs)
    left = TimeLeft((spec.name, item.weight * count) for item, spec, count in jobs)
    made: tuple[str, BenchmarkCase] | None = None
    worker = Worker(protocol.threads) if protocol.isolate else None
    try:
        for item, spec, count in jobs:
            words, began = f"{item.words}: {spec.name}", time.monotonic()
            observe(ComparisonProgress(done, total, left.seconds, words))
            tried = not _gave_up(item, spec, store)
            if tried:
                if made is None or made[0] != item.key:
                    made = (item.key, item.make())
                first = store.done(item.key, spec)
                calls = _calls(worker, spec, made[1].task, count, protocol, curve=item.curve)
                for repeat, engine_call in enumerate(calls, first):
                    run = _judged(item, made[1], spec, repeat, engine_call)
                    store.add([run])
                    part = done + item.weight * (repeat - first + 1)
                    observe(ComparisonProgress(part, total, left.seconds, words, run))
                    if is_last(run):
                        break
            done += item.weight * count
            left.done(spec.name, item.weight * count, time.monotonic() - began if tried else 0.0)
    finally:
        if worker is not None:
            worker.close()


def _calls(
    worker: Worker | None, spec: EngineSpec, task: Task, repeats: int, protocol: Protocol, *, curve: bool
) -> Iterator[EngineCall]:
    """Timed calls; the last brings a curve where one is wanted, from a call of its own if need be."""

    def repeated(task: Task, repeats: int) -> Iterator[EngineCall]:
        if worker is None:
            return calls_here(spec, task, repeats)
        return isolated_calls(worker, spec, task, repeats, protocol.timeout, protocol.memory_limit)

    for number, made in enumerate(repeated(task, repeats), 1):
        if curve and number == repeats and made.output is not None and not made.output.curve:
            again = next(repeated(dataclasses.replace(task, curve=True), 1)).output
            if again is not None:
                made = dataclasses.replace(made, output=dataclasses.replace(made.output, curve=again.curve))
        yield made


def _rejudged(run: RunRecord, success_threshold: float) -> RunRecord:
    """The run with its success by this threshold: older runs of a file may have been judged by another."""
    if run.success is None:
        return run
    return dataclasses.replace(run, success=run.kind == "rigid" and run.worst <= success_threshold * run.size)


def _gave_up(item: PlannedRun, spec: EngineSpec, store: Store) -> bool:
    """Whether an engine ran out of time or memory on a smaller scan of the same axis; a larger one is not tried."""
    return item.row is not None and any(
        run.status in ("timeout", "memory")
        for run in store.runs
        if (run.engine, run.identity, run.axis, run.setting) == (spec.name, spec.identity, *item.row)
    )


def _judged(item: PlannedRun, case: BenchmarkCase, spec: EngineSpec, repeat: int, made: EngineCall) -> RunRecord:
    output = made.output or no_pose("")
    score = judge(output.T_target_source, case.ground_truth)
    worst = worst_along([step.T_target_source for step in output.curve], case.ground_truth).tolist()
    return RunRecord(
        key=item.key,
        engine=spec.name,
        repeat=repeat,
        case=case.case,
        axis=case.axis,
        value=case.value,
        trial=case.trial,
        setting=case.task.setting,
        without_initial_pose=case.task.start is None,
        points=len(case.task.source),
        size=case.ground_truth.size,
        units=case.units,
        status=made.status,
        message=made.message,
        T_target_source=None if made.output is None else output.T_target_source.tolist(),
        seconds=output.seconds,
        prepare_seconds=output.prepare_seconds,
        wall_seconds=made.wall_seconds,
        peak_memory=made.peak_memory,
        iterations=output.iterations,
        self_report=output.self_report,
        settings=json.loads(json.dumps(plain(output.settings), default=str)),
        curve=[(step.iteration, step.seconds, w) for step, w in zip(output.curve, worst, strict=True)],
        identity=spec.identity,
        **dataclasses.asdict(score),
    )
