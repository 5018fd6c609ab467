"""The plots of a comparison, drawn without any global state, in colours that all kinds of vision tell apart."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from dqreg.compare.engines.registry import OURS
from dqreg.compare.records import RunRecord
from dqreg.compare.run import Comparison
from dqreg.compare.summary import SummaryRow, summarise
from dqreg.compare.tables import AXES
from dqreg.report.figure import PALETTE, encode, stacked

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# With more engines than colours, line and marker change too, so that no two look alike.
LINES, MARKERS = ("-", "--", ":", "-."), ("o", "s", "^", "D", "v", "P", "X")
PLOT_INCHES, DOTS_PER_INCH = (8.4, 4.2), 150
# What is drawn as zero on a logarithmic axis.
LEAST_ERROR = 1e-9
ERROR = f"worst vertex error [S], {LEAST_ERROR:g} or less at the foot"
# Noise up to which its axis is linear; by how much lines that lie on each other are moved apart.
LINEAR_NOISE, RATE_STEP = 1e-4, 0.006
OF_FOUND = "of runs that found the pose; ringed: not all did; no mark: none"
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 13, "fillstyle": "none"}
# Height of a line of the legend, and of what is above and below it.
LEGEND_INCHES = (0.185, 0.5)


@dataclasses.dataclass(frozen=True)
class Plot:
    """A picture."""

    key: str  # Its files are ``KEY.png``, ``KEY.svg`` and ``KEY.pdf``
    title: str  # What it shows; also the text for those who cannot see it
    figure: Figure

    def as_file(self, kind: str = "png") -> bytes:
        """The picture as png, svg or pdf."""
        return encode(self.figure, kind)


Style = dict[str, Any]


def plots(found: Comparison) -> list[Plot]:
    """All plots that the runs allow."""
    lines = summarise(found.runs)
    styles = _styles(found.engines)
    made: list[Plot] = []
    for place in dict.fromkeys(line.place for line in lines if line.place.axis == "case"):
        chosen = [line for line in lines if line.place == place]
        name = f"{place.case}, {place.setting}{', no initial pose' if place.without_initial_pose else ''}"
        slug = f"{_slug(place.case)}-{place.setting}"
        made += _error_and_time(chosen, styles, f"error-time-{slug}", f"Error against time: {name}")
    for axis in ("start_angle_deg", "start_offset", "outliers", "overlap"):
        made += _along(lines, axis, styles, "success", lambda line: (line.found or 0) / line.runs)
    made += _along(lines, "noise", styles, "error", lambda line: max(line.worst, LEAST_ERROR), log=True)
    made += _growth(lines, styles)
    base = [line for line in lines if line.place.axis == "start_angle_deg" and line.place.value in (5, 10)]
    for setting in dict.fromkeys(line.place.setting for line in base):
        chosen = [line for line in base if line.place.setting == setting and line.place.value == base[0].place.value]
        made += _error_and_time(
            chosen, styles, f"error-time-{setting}", f"Error against time near the true pose, {setting}"
        )
    return made + _convergence(found, styles)


def _error_and_time(lines: list[SummaryRow], styles: dict[str, Style], key: str, title: str) -> list[Plot]:
    shown = [line for line in lines if line.seconds > 0.0 and math.isfinite(line.worst_all)]
    if not shown:
        return []

    def draw(axes: Axes) -> None:
        for line in shown:
            style = {**styles[line.engine], "linestyle": "none", "markersize": 9}
            axes.errorbar([line.seconds], [max(line.worst_all, LEAST_ERROR)],
                          xerr=[[line.seconds - line.least_seconds], [line.most_seconds - line.seconds]],
                          capsize=2, label=line.engine, **style)  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel="seconds from raw points to pose", ylabel=ERROR)

    return [Plot(key, title, _figure(title, [draw], len(shown)))]


def _along(
    lines: list[SummaryRow],
    axis: str,
    styles: dict[str, Style],
    what: str,
    value: Callable[[SummaryRow], float],
    *,
    log: bool = False,
) -> list[Plot]:
    mine = [line for line in lines if line.place.axis == axis]
    settings = list(dict.fromkeys(line.place.setting for line in mine))
    if not mine:
        return []

    def panel(setting: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            for engine, style in styles.items():
                here = [line for line in mine if (line.engine, line.place.setting) == (engine, setting)]
                points = [(float(line.place.value), value(line)) for line in here if line.place.value is not None]
                points = [(x, y) for x, y in sorted(points) if not math.isnan(y)]
                if points:
                    nudge = 0.0 if log else RATE_STEP * (list(styles).index(engine) - 0.5 * (len(styles) - 1))
                    axes.plot([x for x, _ in points], [y + nudge for _, y in points], label=engine, **style)
                partly = {line.place.value for line in here if log and not line.all_found}
                ringed = [point for point in points if point[0] in partly]
                axes.plot([x for x, _ in ringed], [y for _, y in ringed], **RING, color=style["color"])
            axes.set(xlabel=AXES[axis][0], title=f"setting: {setting}" if len(settings) > 1 else "")
            if log:
                axes.set(yscale="log", ylabel=ERROR, xlabel=f"{AXES[axis][0]}\n{OF_FOUND}")
                axes.set_xscale("symlog", linthresh=LINEAR_NOISE)
                # What is below nothing is not shown.
                axes.set_xlim(-0.1 * LINEAR_NOISE, 1.3 * max(float(line.place.value or 0.0) for line in mine))
            else:
                most = 0.5 * RATE_STEP * (len(styles) - 1)
                apart = f"\nrates are drawn up to {most:.2g} off, so that equal ones are seen" if most else ""
                axes.set(ylabel=f"success rate, of {_runs(mine)}", xlabel=f"{AXES[axis][0]}{apart}", ylim=(-0.1, 1.1))

        return draw

    title = AXES[axis][1]
    return [Plot(f"{what}-{axis}", title, _figure(title, [panel(name) for name in settings], len(styles)))]


def _runs(lines: list[SummaryRow]) -> str:
    """How many runs each point of a curve stands for: a rate of one run is no rate."""
    least, most = (bound(line.runs for line in lines) for bound in (min, max))
    count = f"{most}" if least == most else f"{least} to {most}"
    return f"{count} run{'' if most == 1 else 's'} each"


def _growth(lines: list[SummaryRow], styles: dict[str, Style]) -> list[Plot]:
    mine = [line for line in lines if line.place.axis == "points"]
    if not mine:
        return []

    def panel(value: Callable[[SummaryRow], float], label: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            for engine, style in styles.items():
                here = sorted((line.points, value(line)) for line in mine if line.engine == engine)
                here = [(x, y) for x, y in here if y > 0.0]
                if here:
                    axes.plot([x for x, _ in here], [y for _, y in here], label=engine, **style)
            axes.set(xscale="log", yscale="log", xlabel="scan points", ylabel=label)

        return draw

    title = AXES["points"][1]
    panels = [
        panel(lambda line: line.seconds, "seconds"),
        panel(lambda line: line.peak_memory / 1e6, "peak memory [MB]"),
    ]
    return [Plot("scaling", title, _figure(title, panels, len(styles)))]


def _convergence(found: Comparison, styles: dict[str, Style]) -> list[Plot]:
    settings = dict.fromkeys(run.setting for run in found.runs)
    return [plot for setting in settings for plot in _curves(_typical(found.runs, setting), styles)]


def _curves(chosen: list[RunRecord], styles: dict[str, Style]) -> list[Plot]:
    if not chosen:
        return []

    def panel(column: int, label: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            for run in chosen:
                steps = [(step[column], step[2] / run.size) for step in run.curve]
                steps = [(x, max(y, LEAST_ERROR)) for x, y in steps if not (math.isnan(x) or math.isnan(y))]
                if steps:
                    style = {**styles[run.engine], "markersize": 3}
                    axes.plot([x for x, _ in steps], [y for _, y in steps], label=run.engine, **style)
            axes.set(yscale="log", xlabel=label, ylabel=ERROR)
            if column == 1 and axes.lines:
                axes.set_xscale("log")

        return draw

    first = chosen[0]
    where = first.case if first.axis == "case" else f"{AXES[first.axis][0]} {first.value}"
    title = f"Convergence, {first.setting}: {where}"
    panels = [panel(0, "iteration")]
    if any(not math.isnan(step[1]) for run in chosen for step in run.curve):
        untold = sum(all(math.isnan(step[1]) for step in run.curve) for run in chosen)
        panels.append(panel(1, f"seconds (not told by {untold} of {len(chosen)} engines)" if untold else "seconds"))
    return [Plot(f"convergence-{first.setting}", title, _figure(title, panels, len(chosen)))]


def _typical(runs: Sequence[RunRecord], setting: str) -> list[RunRecord]:
    """One run of each engine with a curve, on the task of a setting where most engines have one."""
    curved = [run for run in runs if run.curve and run.success is not None and run.setting == setting]
    engines: dict[str, dict[str, RunRecord]] = {}
    for run in curved:
        engines.setdefault(run.key, {})[run.engine] = run
    if not engines:
        return []
    return list(max(engines.values(), key=len).values())


def _styles(engines: Sequence[str]) -> dict[str, Style]:
    styles = {}
    for index, engine in enumerate(engines):
        turn = index // len(PALETTE)
        ours = engine in OURS
        styles[engine] = {
            "color": PALETTE[index % len(PALETTE)],
            "linestyle": LINES[turn % len(LINES)],
            "marker": MARKERS[(index + turn) % len(MARKERS)],
            "linewidth": 2.6 if ours else 1.4,
            "markersize": 6,
            "zorder": 3 if ours else 2,
        }
    return styles


def _figure(title: str, panels: Sequence[Callable[[Axes], None]], named_lines: int) -> Figure:
    width, height = PLOT_INCHES
    line, margin = LEGEND_INCHES
    # The legend stands beside all panels together, a line for each engine.
    height = max(height, (line * named_lines + margin) / len(panels))
    figure, rows = stacked(panels, width, [height] * len(panels), DOTS_PER_INCH)
    figure.suptitle(title, fontsize="large", x=0.01, ha="left")
    named: dict[str, Any] = {}
    for axes in rows:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        # Beside the axes, where it hides no curve.
        figure.legend(named.values(), named.keys(), loc="outside right upper", frameon=False, fontsize="small",
                      handlelength=3.0)  # fmt: skip
    return figure


def _slug(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text)
