"""The tables, made once as text: every place that shows them shows the same numbers."""

from __future__ import annotations

import collections
import math
from typing import Any

from dqreg.compare.proportions import share_words
from dqreg.compare.run import Comparison
from dqreg.compare.summary import SummaryRow, largest_reliable, median, summarise, summary_key, time_exponent
from dqreg.report.table import Column, Table

MISSING, REMARK = "-", "remark"
INTERVAL = "95 % intervals (Clopper and Pearson)"
LESS = "Give a smaller --success than the initial pose is off."
AXES = {
    "start_angle_deg": ("initial rotation [deg]", "Convergence basin: rotation of the initial pose"),
    "start_offset": ("initial translation [S]", "Convergence basin: translation of the initial pose"),
    "noise": ("noise [S]", "Sensitivity to noise"),
    "outliers": ("outlier fraction", "Sensitivity to outliers"),
    "overlap": ("overlap", "Scan to scan: smallest overlap"),
    "points": ("scan points", "Run time by scan points"),
    "nothing": ("part", "Global registration: no initial pose"),
    "frame": ("coordinates", "The same task in other units and far from the origin"),
}


def _columns(*heads: str) -> tuple[Column, ...]:
    """The engine to the left, then numbers as text, and remarks that may wrap."""
    words = Column(REMARK, align="left", wraps=True)
    numbers = (words if head == REMARK else Column(head, align="right") for head in heads[1:])
    return Column(heads[0], align="left"), *numbers


def tables(found: Comparison) -> list[Table]:
    """All tables of a comparison."""
    lines = summarise(found.runs)
    places = list(dict.fromkeys(summary_key(run) for run in found.runs))
    starts = {line.place: line for line in summarise(found.starts)}
    made = [
        _case(found, [line for line in lines if line.place == place], starts.get(place))
        for place in places
        if place.axis == "case"
    ]
    for setting in dict.fromkeys(place.setting for place in places if place.axis == "case"):
        made += _over_cases(found, setting, [line for line in lines if line.place.axis == "case"])
    axes = list(dict.fromkeys((place.axis, place.setting) for place in places if place.axis != "case"))
    if axes:
        made.append(_answers(found, lines))
    for axis, setting in axes:
        chosen = [line for line in lines if (line.place.axis, line.place.setting) == (axis, setting)]
        made.extend(_axis(found, axis, setting, chosen))
    return made


def _case(found: Comparison, lines: list[SummaryRow], given: SummaryRow | None) -> Table:
    place, unit = lines[0].place, lines[0].units or "target units"
    start = "no initial pose" if place.without_initial_pose else "from the given initial pose"
    title = f"{place.case}, {_words(place.setting)}, {start}: {lines[0].points} points, S = {lines[0].size:.4g} {unit}"
    head = ("engine", "found", "worst vertex [S]", f"rms [{unit}]", "angle [deg]", f"on surface [{unit}]", "overlap",
            "seconds", "range", "peak MB", REMARK)  # fmt: skip
    rows = [
        (
            line.engine,
            _share(line),
            number(line.worst_all if line.found is not None else math.nan),
            number(line.rms * line.size),
            number(math.degrees(line.angle_rad)),
            number(line.surface_rms * line.size),
            f"{100 * line.overlap:.1f} %" if not math.isnan(line.overlap) else MISSING,
            number(line.seconds),
            f"{number(line.least_seconds)} - {number(line.most_seconds)}" if line.runs > 1 else MISSING,
            number(line.peak_memory / 1e6),
            line.remark,
        )
        for line in ([] if given is None else [given]) + _in_order(found, lines)
    ]
    note = ("Found: of repeats of this one task, which tell nothing of others. Worst vertex: median over all runs of "
            "the greatest displacement of a point of the part. On surface: rms distance of scan points that no engine "
            "was given, of those that lie on the target; overlap: their fraction. Peak MB: growth of the process above "
            "its inputs, without programs that it starts.")  # fmt: skip
    if given is not None and given.found:
        note = f"The initial pose already counts as found: whoever does nothing has found it too. {LESS} {note}"
    return Table(f"case-{place.case}-{place.setting}", title, _columns(*head), tuple(rows), note)


def _over_cases(found: Comparison, setting: str, lines: list[SummaryRow]) -> list[Table]:
    """One row an engine over all cases with a truth, where there are several."""
    chosen = [line for line in lines if line.place.setting == setting and line.found is not None]
    if len({line.place for line in chosen}) < 2:
        return []
    rows = []
    for engine in found.engines:
        mine = [line for line in chosen if line.engine == engine]
        if mine:
            rows.append((engine, _sum(mine), number(median(line.worst for line in mine)), _seconds_of(mine)))
    note = f"A case is found if every run of it was. Medians over the cases that were found. In brackets: {INTERVAL}."
    head = ("engine", "cases found", "worst vertex [S]", "seconds")
    return [Table(f"cases-{setting}", f"All cases, {_words(setting)}", _columns(*head), tuple(rows), note)]


def _seconds_of(lines: list[SummaryRow]) -> str:
    return number(median(line.seconds for line in lines if line.found))


def _answers(found: Comparison, lines: list[SummaryRow]) -> Table:
    head = ("engine", "rotation [deg]", "translation [S]", "noise [S]", "outliers", "overlap", "no initial pose",
            "worst vertex [S]", "seconds", "at 1M points", "growth")  # fmt: skip
    rows = []
    for engine in found.engines:
        mine = [line for line in lines if line.engine == engine and line.place.setting == "manual"]
        near = [line for line in mine if line.place.axis in ("start_angle_deg", "frame")]
        base = [line for line in near if line.place.value in (5, 10, "mm")]
        million = [line for line in mine if line.place.axis == "points" and line.place.value == 1_000_000]
        blind = [line for line in mine if line.place.axis == "nothing"]
        rows.append((
            engine,
            *(number(largest_reliable(mine, engine, axis, "manual"))
              for axis in ("start_angle_deg", "start_offset", "noise", "outliers", "overlap")),
            _sum(blind),
            _of_found(base),
            _seconds_of(base),
            number(million[0].seconds) if million else MISSING,
            number(time_exponent(mine, engine)),
        ))  # fmt: skip
    note = ("Rotation to overlap: the largest value up to which all runs succeeded, in the setting as its "
            "manual says; '-' if not even the first. Worst vertex and seconds: medians at initial poses 5 and 10 "
            "degrees off, of those that were found; how many were stands behind. Growth: exponent of time over "
            f"points, 1 is linear. In brackets: {INTERVAL}.")  # fmt: skip
    return Table("answers", "Summary", _columns(*head), tuple(rows), note)


def _axis(found: Comparison, axis: str, setting: str, lines: list[SummaryRow]) -> list[Table]:
    label, title = AXES[axis]
    values = list(dict.fromkeys(line.place.value for line in lines))
    heads = ("engine", *(_value(value) for value in values))
    by = {(line.engine, line.place.value): line for line in lines}
    names = [name for name in found.engines if any((name, value) in by for value in values)]

    def grid(key: str, what: str, cell: Any, note: str) -> Table:
        rows = tuple((name, *(cell(by.get((name, value))) for value in values)) for name in names)
        return Table(
            f"{axis}-{setting}-{key}", f"{title} ({_words(setting)}): {what} by {label}", _columns(*heads), rows, note
        )

    found_of = f"Found: successful runs of all runs.{_intervals(lines)}"
    worst = "Worst vertex [S]: median of those that were found."
    if axis == "points":
        return [
            grid("seconds", "seconds", _seconds, "From raw points to pose; '>' : not within the time limit."),
            grid(
                "memory", "peak MB", _memory, "Growth of the process above its inputs, without programs that it starts."
            ),
            grid("worst", "found, worst vertex [S]", _found_and_worst, f"{found_of} {worst}"),
        ]
    if axis == "frame":
        note = "All three are the same task: a method that knows no absolute lengths gives three times the same number."
        return [grid("worst", "found, worst vertex [S]", _found_and_worst, f"{found_of} {worst} {note}")]
    if axis == "nothing":
        return [grid("found", "found, worst vertex [S], seconds", _found_worst_seconds, f"{found_of} {worst}")]
    return [grid("found", "found, worst vertex [S]", _found_and_worst, f"{found_of} {worst}")]


def _found_and_worst(line: SummaryRow | None) -> str:
    if line is None:
        return MISSING
    return _share(line) + (f"  {number(line.worst)}" if line.found else "")


def _found_worst_seconds(line: SummaryRow | None) -> str:
    if line is None or math.isnan(line.seconds):
        return _found_and_worst(line)
    return f"{_found_and_worst(line)}  {number(line.seconds)} s"


def _seconds(line: SummaryRow | None) -> str:
    if line is None:
        return MISSING
    if math.isnan(line.seconds):
        return ">" if line.timed_out else "failed"
    return number(line.seconds)


def _memory(line: SummaryRow | None) -> str:
    return MISSING if line is None else number(line.peak_memory / 1e6)


def number(value: float) -> str:
    """A number in two or three digits that mean something."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "none"
    if value == 0.0:
        return "0"
    if abs(value) >= 100.0:
        return f"{value:.0f}"
    if abs(value) >= 1e-2:
        return f"{value:.3g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _in_order(found: Comparison, lines: list[SummaryRow]) -> list[SummaryRow]:
    return sorted(lines, key=lambda line: found.engines.index(line.engine))


def _share(line: SummaryRow) -> str:
    return MISSING if line.found is None else f"{line.found}/{line.runs}"


def _sum(lines: list[SummaryRow]) -> str:
    """Tasks found of all tasks, with the interval."""
    if not lines:
        return MISSING
    return share_words(sum(line.tasks_found for line in lines), sum(line.tasks for line in lines))


def _of_found(lines: list[SummaryRow]) -> str:
    """Median error of what was found, and how much of it was."""
    return f"{number(median(line.worst for line in lines))}, {_sum(lines)}" if lines else MISSING


def _intervals(lines: list[SummaryRow]) -> str:
    """The interval of each count of a table, most successful first."""
    counts = {(line.tasks_found, line.tasks) for line in lines if line.found is not None and line.tasks > 1}
    if not counts:
        return ""
    return f" {INTERVAL}: {', '.join(share_words(*each) for each in sorted(counts, reverse=True))}."


def _words(setting: str) -> str:
    return {"manual": "as its manual says", "same-loop": "same loop"}.get(setting, setting)


def _value(value: str | float | None) -> str:
    if isinstance(value, (int, float)):
        return f"{value / 1e6:g}M" if value >= 1e6 else f"{value / 1e3:g}k" if value >= 1e4 else f"{value:g}"
    return str(value)


def _late(found: Comparison) -> list[str]:
    """What the time limit cut off, which a table alone shows as not found."""
    late = collections.Counter(run.engine for run in found.runs if run.status == "timeout")
    if not late:
        return []
    runs = collections.Counter(run.engine for run in found.runs)
    words = ", ".join(f"{name} {count} of {runs[name]} runs" for name, count in late.items())
    return [f"Cut off by the time limit, and so not found: {words}; a longer --timeout makes these again."]


def footer(found: Comparison, home: float) -> str:
    """Protocol and machine in a few sentences, to stand under the tables."""
    machines = list(dict.fromkeys(str(session.get("machine", "")) for session in found.sessions))
    threads = sorted({str(session.get("threads", "")) for session in found.sessions})
    versions: dict[str, str] = {}
    for one in found.sessions:
        versions |= one.get("versions", {})
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    text = [
        f"Found: no point of the part farther than {home:g} S from its true place.",
        f"{'Machine' if len(machines) == 1 else 'Machines'}: {'; '.join(machines)}; threads: {', '.join(threads)}.",
        f"{named}.",
        *([found.kept] if found.kept else []),
        *_late(found),
        *found.hints,
    ]
    if found.unfit:
        text.append(f"Took no part: {'; '.join(f'{name} ({why})' for name, why in found.unfit.items())}.")
    if found.missing:
        missing = "; ".join(f"{name} (pip install {' '.join(needs)})" for name, needs in found.missing.items())
        text.append(f"Not installed: {missing}.")
    return " ".join(text)
