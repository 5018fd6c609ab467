"""Summary of runs: one row for each engine and kind of task, and the figures of a sweep."""

from __future__ import annotations

import dataclasses
import math
import statistics
import textwrap
from collections.abc import Iterable, Sequence

from dqreg.compare.proportions import interval
from dqreg.compare.records import RunRecord

# An engine may leave as much out of its time as it tells, and this: what is copied before and after it.
UNTOLD_SECONDS = 0.1


@dataclasses.dataclass(frozen=True)
class SummaryKey:
    """What runs of one summary row have in common."""

    # As in `dqreg.compare.records.RunRecord`; on an axis of a sweep the case is ""
    case: str
    axis: str
    value: str | float | None
    setting: str
    without_initial_pose: bool


@dataclasses.dataclass(frozen=True)
class SummaryRow:
    """Medians over the runs of an engine with one key, NaN where there are none; the names are keys of the JSON."""

    engine: str
    place: SummaryKey
    runs: int
    found: int | None  # Successful runs; None where no truth is known
    # tasks, tasks_found: Different tasks, and those of which every run was successful: repeats tell nothing of others
    tasks: int
    tasks_found: int
    # found_low, found_high: 95 % interval of the fraction of such tasks that is found; NaN for a single one
    found_low: float
    found_high: float
    # worst, rms, angle_rad: Of successful runs: worst and rms displacement in S, angle
    worst: float
    rms: float
    angle_rad: float
    # Worst displacement in S of all runs, infinite for those without a pose: accuracy with failures counted
    worst_all: float
    surface_rms: float  # In S, of all runs with a pose
    overlap: float  # Fraction of the held-out points on the target, of all runs with a pose
    # seconds, least_seconds, most_seconds, prepare_seconds: Of all runs that came back
    seconds: float
    least_seconds: float
    most_seconds: float
    prepare_seconds: float
    peak_memory: float  # Bytes
    points: int  # Scan points
    size: float  # S
    units: str  # Of S
    remark: str  # What went wrong in unsuccessful runs
    timed_out: bool  # Whether the first of these ended at the time limit

    @property
    def all_found(self) -> bool:
        """Whether every run was successful."""
        return self.found == self.runs


def summary_key(run: RunRecord) -> SummaryKey:
    """Summary key of a run."""
    case = run.case if run.axis == "case" else ""
    return SummaryKey(case, run.axis, run.value, run.setting, run.without_initial_pose)


def summarise(runs: Iterable[RunRecord]) -> list[SummaryRow]:
    """One row for each engine and key, in the order in which they first ran."""
    groups: dict[tuple[SummaryKey, str], list[RunRecord]] = {}
    for run in runs:
        groups.setdefault((summary_key(run), run.engine), []).append(run)
    return [_row(key, engine, group) for (key, engine), group in groups.items()]


def median(values: Iterable[float]) -> float:
    """Median of the numbers that are not NaN; NaN for none."""
    known = [value for value in values if not math.isnan(value)]
    return statistics.median(known) if known else math.nan


def largest_reliable(rows: Sequence[SummaryRow], engine: str, axis: str, setting: str) -> float:
    """Value of an axis, by size, up to which every run of an engine was successful; NaN for none.

    Tasks are harder the larger the value is, but for the overlap: there it is the smallest.
    """
    found: dict[float, bool] = {}
    for row in rows:
        value = row.place.value
        if (row.engine, row.place.axis, row.place.setting) == (engine, axis, setting) and isinstance(
            value, int | float
        ):
            found[float(value)] = row.all_found and found.get(float(value), True)
    hardest = math.nan
    # Not as the runs come: a comparison that went on later has its easy tasks last.
    for value in sorted(found, reverse=axis == "overlap"):
        if not found[value]:
            break
        hardest = value
    return hardest


def time_exponent(rows: Sequence[SummaryRow], engine: str) -> float:
    """Exponent with which time grows with the number of points: 1 is linear; NaN for fewer than three sizes."""
    pairs = [
        (math.log(row.points), math.log(row.seconds))
        for row in rows
        if row.engine == engine and row.place.axis == "points" and row.seconds > 0.0
    ]
    if len(pairs) < 3:
        return math.nan
    return float(statistics.linear_regression(*zip(*pairs, strict=True)).slope)


def _row(key: SummaryKey, engine: str, runs: list[RunRecord]) -> SummaryRow:
    good = [run for run in runs if run.success]
    back = [run for run in runs if run.status == "ran"]
    posed = [run for run in back if run.kind != "nothing"]
    seconds = [run.seconds for run in back if not math.isnan(run.seconds)]
    truth = any(run.success is not None for run in runs)
    tasks = {run.key for run in runs}
    tasks_found = len(tasks - {run.key for run in runs if not run.success})
    low, high = interval(tasks_found, len(tasks)) if truth and len(tasks) > 1 else (math.nan, math.nan)
    last, bad = runs[-1], [run for run in runs if run.success is not True]
    return SummaryRow(
        engine=engine,
        place=key,
        runs=len(runs),
        found=len(good) if truth else None,
        tasks=len(tasks),
        tasks_found=tasks_found,
        found_low=low,
        found_high=high,
        worst=median(run.worst / run.size for run in good),
        rms=median(run.rms / run.size for run in good),
        angle_rad=median(run.angle_rad for run in good),
        worst_all=median(math.inf if math.isnan(run.worst) else run.worst / run.size for run in runs)
        if truth
        else math.nan,
        surface_rms=median(run.surface_rms / run.size for run in posed),
        overlap=median(run.overlap for run in posed),
        seconds=median(seconds),
        least_seconds=min(seconds, default=math.nan),
        most_seconds=max(seconds, default=math.nan),
        prepare_seconds=median(run.prepare_seconds for run in back),
        peak_memory=median(run.peak_memory for run in back),
        points=last.points,
        size=last.size,
        units=last.units,
        remark="; ".join(word for word in (_remark(bad), _claim(back)) if word),
        timed_out=bool(bad) and bad[0].status == "timeout",
    )


def _claim(runs: list[RunRecord]) -> str:
    """That an engine tells much less time than passed."""
    told, passed = (median(getattr(run, name) for run in runs) for name in ("seconds", "wall_seconds"))
    if not passed - told > max(told, UNTOLD_SECONDS):
        return ""
    return f"tells {told:.2g} s, {passed:.2g} s passed"


def _remark(runs: list[RunRecord]) -> str:
    """Reasons of unsuccessful runs, each once, with its count."""
    words = [_word(run) for run in runs]
    counts = {word: words.count(word) for word in words if word}
    return "; ".join(
        word if count == len(runs) or count == 1 else f"{word} ({count})" for word, count in counts.items()
    )


def _word(run: RunRecord) -> str:
    if run.status == "timeout":
        return run.message or "timeout"
    if run.status != "ran":
        return textwrap.shorten(f"{run.status}: {run.message}", 90, placeholder=" ...")
    if run.kind == "nothing":
        return "no pose found" + (f" ({run.self_report})" if run.self_report else "")
    if run.kind != "rigid":
        return f"pose is {run.kind}"
    if run.success is None:
        return ""
    return "wrong pose"
