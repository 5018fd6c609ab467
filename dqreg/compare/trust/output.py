"""A trust sweep as JSON, Markdown, CSV and one HTML page."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqreg.compare.output import Goals, to_html
from dqreg.compare.plots import DOTS_PER_INCH, Plot
from dqreg.compare.trust.calibration import Calibration, calibration_of, calibration_table
from dqreg.compare.trust.rates import Rate, rates, tables
from dqreg.compare.trust.sweep import FORMAT, TrustSweep
from dqreg.files.atomic import write_atomically
from dqreg.files.csv_text import csv_text
from dqreg.files.strict_json import plain
from dqreg.report.figure import PALETTE, stacked
from dqreg.report.page_file import page_content
from dqreg.report.table import Table, to_markdown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLE = "how far the verdict can be trusted"
# Width of the reliability diagram.
DIAGRAM_INCHES = 5.0


def to_json(sweep: TrustSweep) -> str:
    """All of a sweep as strict JSON."""
    values = {
        "format": FORMAT,
        "first_seed": sweep.seeds[0],
        "seeds": sweep.seeds[1],
        "sessions": sweep.sessions,
        "rates": rates(sweep),
        "calibration": calibration_of(sweep.trials),
        "trials": sweep.trials,
    }
    return json.dumps(plain(values), allow_nan=False) + "\n"


def to_rows(made: Sequence[Rate]) -> str:
    """The rates at full precision as CSV."""
    names = [field.name for field in dataclasses.fields(Rate) if field.name != "codes"]
    return csv_text(names, ([getattr(rate, name) for name in names] for rate in made))


def tables_of(sweep: TrustSweep) -> list[Table]:
    """All tables of a sweep: the rates, how well the confidence is calibrated, and what was judged wrongly."""
    made, found = tables(sweep), calibration_of(sweep.trials)
    return [*made[:2], calibration_table(found), *made[2:]] if found.trials else made


def note_of(sweep: TrustSweep) -> str:
    """What was done, in one sentence."""
    first, count = sweep.seeds
    return (
        f"{len(sweep.trials)} tasks of {len(sweep.kinds)} kinds, seeds {first} to {first + count - 1}; parts are drawn "
        "with random dimensions; a pose is right if no point of the part is displaced by more than 2 % of its diagonal."
    )


def write(sweep: TrustSweep, goals: Goals, command: str) -> list[Path]:
    """Write all that is asked for."""
    made, found = tables_of(sweep), calibration_of(sweep.trials)
    contents: dict[Path, str | bytes] = {}
    if goals.out is not None:
        contents[goals.out] = to_json(sweep)
    if goals.markdown is not None:
        contents[goals.markdown] = to_markdown(made, note_of(sweep))
    if goals.csv is not None:
        contents[goals.csv] = to_rows(rates(sweep))
    if goals.report is not None:
        plots = [reliability_plot(found)] if found.bins else []
        page = to_html(TITLE, made, plots, note_of(sweep), command)
        contents[goals.report] = page_content(goals.report, page)
    for path, content in contents.items():
        write_atomically(path, content)
    return list(contents)


def reliability_plot(found: Calibration) -> Plot:
    """Fraction of right poses over the confidence, with 95 % intervals, and how many tasks each bin has."""

    def diagram(axes: Axes) -> None:
        x, y = [one.confidence for one in found.bins], [one.right for one in found.bins]
        below = [one.right - one.right_low for one in found.bins]
        above = [one.right_high - one.right for one in found.bins]
        axes.plot([0, 1], [0, 1], color=PALETTE[6], linestyle=":", label="perfect")
        axes.errorbar(x, y, yerr=[below, above], fmt="o-", color=PALETTE[0], capsize=3, label="measured, 95 %")
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.02, 1.02)
        axes.set_ylabel("fraction of right poses")
        axes.legend(loc="upper left")

    def counts(axes: Axes) -> None:
        axes.bar([0.5 * (one.low + one.high) for one in found.bins], [one.trials for one in found.bins],
                 width=0.09, color=PALETTE[5])  # fmt: skip
        axes.set_xlim(-0.02, 1.02)
        axes.set_xlabel("confidence of the verdict")
        axes.set_ylabel("tasks")

    figure, _ = stacked((diagram, counts), DIAGRAM_INCHES, (4.0, 1.4), DOTS_PER_INCH)
    title = "Reliability: how often poses of a given confidence are right"
    return Plot("reliability", title, figure)
