"""The files of a comparison; their places are asked for before the work, and they are written after it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

from dqreg.compare.plots import Plot, plots
from dqreg.compare.run import Comparison
from dqreg.compare.store import FORMAT
from dqreg.compare.summary import SummaryRow, summarise
from dqreg.errors import InputError
from dqreg.files.atomic import is_stream, require_folder, require_writable, write_atomically
from dqreg.files.csv_text import csv_text
from dqreg.files.strict_json import plain
from dqreg.report.html import data_uri, render
from dqreg.report.page_file import page_content, page_path
from dqreg.report.table import Table, to_markdown

# Files of a plot: for a screen, a page and a paper.
KINDS = ("png", "svg", "pdf")


def to_html(title: str, made: Sequence[Table], pictures: Sequence[Plot], note: str, command: str = "") -> str:
    """Page of a comparison."""
    shown = [(plot, data_uri(plot.as_file())) for plot in pictures]
    return render("compare.html", title=title, tables=made, plots=shown, note=note, command=command)


@dataclasses.dataclass(frozen=True)
class Goals:
    """Where to write what; None writes nothing."""

    out: Path | None = None  # JSON with all runs and the summary; the runs also stand in a file of JSON lines beside it
    report: Path | None = None  # HTML page
    # markdown, csv: Tables; the summary at full precision
    markdown: Path | None = None
    csv: Path | None = None
    plots: Path | None = None  # Folder for pictures of all kinds; made if it is missing

    @property
    def lines(self) -> Path | None:
        """JSON lines, from which a comparison resumes: ``out`` with the ending .jsonl; None where that is a device."""
        return None if self.out is None or is_stream(self.out) else self.out.with_suffix(".jsonl")

    def check(self) -> None:
        """Raise unless all can be written."""
        for path in (self.out, self.lines, self.report, self.markdown, self.csv):
            if path is not None:
                require_writable(path)
        if self.report is not None:
            page_path(self.report)
        if self.out is not None and self.out == self.lines:
            raise InputError(f"--out {self.out}: give a .json file; the single runs go to {self.lines} beside it")
        if self.plots is not None:
            require_folder(self.plots)


def write(found: Comparison, made: Sequence[Table], goals: Goals, note: str, command: str) -> list[Path]:
    """Write all that is asked for."""
    pictures = plots(found) if goals.report is not None or goals.plots is not None else []
    contents: dict[Path, str | bytes] = {}
    if goals.out is not None:
        contents[goals.out] = to_json(found)
    if goals.markdown is not None:
        contents[goals.markdown] = to_markdown(made, note)
    if goals.csv is not None:
        contents[goals.csv] = summary_csv(summarise(found.runs))
    if goals.report is not None:
        contents[goals.report] = page_content(goals.report, to_html(found.title, made, pictures, note, command))
    if goals.plots is not None:
        contents |= {goals.plots / f"{plot.key}.{kind}": plot.as_file(kind) for plot in pictures for kind in KINDS}
    for path, content in contents.items():
        write_atomically(path, content)
    return list(contents)


def to_json(found: Comparison) -> str:
    """All of a comparison as strict JSON."""
    values = {
        "format": FORMAT,
        "title": found.title,
        "engines": found.engines,
        "missing": found.missing,
        "sessions": found.sessions,
        "summary": summarise(found.runs),
        "initial_poses": found.starts,
        "runs": found.runs,
    }
    return json.dumps(plain(values), allow_nan=False) + "\n"


def summary_csv(lines: Sequence[SummaryRow]) -> str:
    """Every line of the summary at full precision."""
    places = ("case", "axis", "value", "setting", "without_initial_pose")
    numbers = [
        field.name for field in dataclasses.fields(SummaryRow) if field.name not in ("engine", "place", "timed_out")
    ]
    rows = (
        (line.engine, *(getattr(line.place, name) for name in places), *(getattr(line, name) for name in numbers))
        for line in lines
    )
    return csv_text(("engine", *places, *numbers), rows)
