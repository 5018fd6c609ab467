"""What the runs say together: one line for each engine at each place, and the answers of a sweep."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterable, Sequence

from dqreg.compare.records import Run

NAN = float("nan")


@dataclasses.dataclass(frozen=True)
class Place:
    """Where tasks were: runs of one place are summed up together."""

    # case, axis, value, setting, from_nothing: As in `dqreg.compare.records.Run`; on an axis of a sweep the case is ""
    case: str
    axis: str
    value: str | float | None
    setting: str
    from_nothing: bool


@dataclasses.dataclass(frozen=True)
class Line:
    """An engine at a place; medians, NaN where there is nothing to take one of."""

    engine: str  # Its name
    place: Place  # Where
    runs: int  # How many
    found: int | None  # How many of them brought the scan home; None where no truth is known
    # worst, rms, angle_rad: Of those that brought it home: worst and rms displacement in S, angle
    worst: float
    rms: float
    angle_rad: float
    # Worst displacement in S of all runs, infinite for those without a pose: exactness that failures spoil
    worst_all: float
    surface_rms: float  # In S, of all runs with a pose
    overlap: float  # Share of the held-out points on the target, of all runs with a pose
    # seconds, least_seconds, most_seconds, prepare_seconds: Of all runs that came back
    seconds: float
    least_seconds: float
    most_seconds: float
    prepare_seconds: float
    peak_memory: float  # Bytes
    points: int  # Scan points
    size: float  # S
    units: str  # Of S
    remark: str  # What went wrong in runs that brought nothing home
    is_late: bool = False  # Whether the first of these ended with the time limit

    @property
    def all_found(self) -> bool:
        """Whether every run brought the scan home."""
        return self.found == self.runs


def place_of(run: Run) -> Place:
    """Place of a run."""
    case = run.case if run.axis == "case" else ""
    return Place(case, run.axis, run.value, run.setting, run.from_nothing)


def summarise(runs: Iterable[Run]) -> list[Line]:
    """One line for each engine at each place, in the order in which they first ran."""
    groups: dict[tuple[Place, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((place_of(run), run.engine), []).append(run)
    return [_line(place, engine, group) for (place, engine), group in groups.items()]


def median(values: Iterable[float]) -> float:
    """Median of the numbers that are not NaN; NaN for none."""
    known = [value for value in values if not math.isnan(value)]
    return statistics.median(known) if known else NAN


def reach(lines: Sequence[Line], engine: str, axis: str, setting: str) -> float:
    """Largest value of an axis up to which every run of an engine brought the scan home; NaN for none."""
    return _along(lines, engine, axis, setting, lambda line: line.all_found)


def growth(lines: Sequence[Line], engine: str) -> float:
    """Exponent with which time grows with the number of points: 1 is linear; NaN for fewer than three sizes."""
    pairs = [
        (math.log(line.points), math.log(line.seconds))
        for line in lines
        if line.engine == engine and line.place.axis == "points" and line.seconds > 0.0
    ]
    if len(pairs) < 3:
        return NAN
    return float(statistics.linear_regression(*zip(*pairs, strict=True)).slope)


def _along(lines: Sequence[Line], engine: str, axis: str, setting: str, good: Callable[[Line], bool]) -> float:
    best = NAN
    for line in lines:
        if (line.engine, line.place.axis, line.place.setting) == (engine, axis, setting):
            if not good(line) or not isinstance(line.place.value, (int, float)):
                break
            best = float(line.place.value)
    return best


def _line(place: Place, engine: str, runs: list[Run]) -> Line:
    home = [run for run in runs if run.success]
    back = [run for run in runs if run.status == "ran"]
    posed = [run for run in back if run.kind != "nothing"]
    seconds = [run.seconds for run in back if not math.isnan(run.seconds)]
    truth = any(run.success is not None for run in runs)
    last, bad = runs[-1], [run for run in runs if run.success is not True]
    return Line(
        engine=engine,
        place=place,
        runs=len(runs),
        found=len(home) if truth else None,
        worst=median(run.worst / run.size for run in home),
        rms=median(run.rms / run.size for run in home),
        angle_rad=median(run.angle_rad for run in home),
        worst_all=median(math.inf if math.isnan(run.worst) else run.worst / run.size for run in runs) if truth else NAN,
        surface_rms=median(run.surface_rms / run.size for run in posed),
        overlap=median(run.overlap for run in posed),
        seconds=median(seconds),
        least_seconds=min(seconds, default=NAN),
        most_seconds=max(seconds, default=NAN),
        prepare_seconds=median(run.prepare_seconds for run in back),
        peak_memory=median(run.peak_memory for run in back),
        points=last.points,
        size=last.size,
        units=last.units,
        remark=_remark(bad),
        is_late=bool(bad) and bad[0].status == "timeout",
    )


def _remark(runs: list[Run]) -> str:
    """What befell the runs that did not succeed, each kind once, with its count."""
    words = [_word(run) for run in runs]
    counts = {word: words.count(word) for word in words if word}
    return "; ".join(
        word if count == len(runs) or count == 1 else f"{word} ({count})" for word, count in counts.items()
    )


def _word(run: Run) -> str:
    if run.status == "timeout":
        return run.message or "timeout"
    if run.status != "ran":
        return f"{run.status}: {run.message}"[:90]
    if run.kind == "nothing":
        return "no pose found" + (f" ({run.claims})" if run.claims else "")
    if run.kind != "rigid":
        return f"pose is {run.kind}"
    if run.success is None:
        return ""
    return "wrong pose"
