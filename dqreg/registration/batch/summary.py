"""The summary of a batch: one line a row, as CSV and as one HTML page that needs nothing else."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from dqreg.files.csv_text import csv_text
from dqreg.files.length_names import column_head
from dqreg.registration.batch.line import Line
from dqreg.registration.batch.trends import trends_of, trends_on_page
from dqreg.report.decision_rows import shown_outcome
from dqreg.report.html import data_uri, render

# From the one that needs a look first to the one that needs none.
VERDICTS = ("crashed", "timeout", "memory", "error", "not run", "failed", "suspect", "accepted")
POSE = ("tx", "ty", "tz", "qw", "qx", "qy", "qz")
# Of the CSV, with what stands in them.
COLUMNS: dict[str, Callable[[Line], object]] = {
    "name": lambda line: line.row.shown,
    "verdict": lambda line: line.verdict,
    "reasons": lambda line: "; ".join(line.reasons),
    "rms": lambda line: line.rms,
    "inlier_fraction": lambda line: line.inlier_fraction,
    "seconds": lambda line: line.seconds,
    "tx": lambda line: line.pose[0],
    "ty": lambda line: line.pose[1],
    "tz": lambda line: line.pose[2],
    "qw": lambda line: line.pose[3],
    "qx": lambda line: line.pose[4],
    "qy": lambda line: line.pose[5],
    "qz": lambda line: line.pose[6],
    "scan": lambda line: line.row.scan,
    "target": lambda line: line.row.target,
    "result": lambda line: line.result,
    "line": lambda line: line.row.line,
    "part": lambda line: line.part,
    "report": lambda line: line.report,
    "unit": lambda line: line.unit,
    "deviation_p95": lambda line: line.figure("p95"),
    "share_within": lambda line: line.figure("share_within"),
    "share_scanned": lambda line: line.figure("scanned"),
    "scale_solved": lambda line: line.scale,
}


def summary_csv(lines: Sequence[Line]) -> str:
    """The summary as CSV, numbers at full precision; a unit that was asked for stands in the heads of the lengths.

    Fields of the reports' heads, such as the serial number, are the last columns.
    """
    asked = {line.row.asked.display_units for line in lines if line.ran}
    unit = asked.pop() if len(asked) == 1 else None
    heads = [column_head(name, unit) for name in COLUMNS]
    fields = tuple(dict.fromkeys(name for line in lines for name, _ in line.row.asked.head))
    # One called like a column is told from it.
    heads += [f"head_{name}" if name in COLUMNS else name for name in fields]
    return csv_text(heads, (_csv_row(line, fields) for line in lines))


def _csv_row(line: Line, fields: Sequence[str]) -> tuple[object, ...]:
    cells, head = (cell(line) for cell in COLUMNS.values()), dict(line.row.asked.head)
    written = ("" if isinstance(cell, float) and math.isnan(cell) else cell for cell in cells)
    return (*written, *(head.get(name, "") for name in fields))


def to_records(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """The summary as plain values."""
    return [
        {
            "name": line.row.shown,
            "verdict": line.verdict,
            "reasons": list(line.reasons),
            "units": line.unit or None,
            "rms": line.rms,
            "inlier_fraction": line.inlier_fraction,
            "seconds": line.seconds,
            "pose": None if math.isnan(line.pose[0]) else dict(zip(POSE, line.pose, strict=True)),
            "scan": str(line.row.scan),
            "target": str(line.row.target),
            "result": line.result or None,
            "line": line.row.line,
            "kept": line.kept,
            "part": line.part or None,
            "alignment_trusted": line.verdict == "accepted",
            "report": line.report or None,
            "head": dict(line.row.asked.head),
            "scale_solved": None if math.isnan(line.scale) else line.scale,
            "inspection": line.inspection,
        }
        for line in lines
    ]


def to_html(title: str, lines: Sequence[Line], thumbnails: Path | None = None) -> str:
    """The summary as a page that loads nothing; a click on a head sorts."""
    return render(
        "batch.html",
        title=title,
        lines=lines,
        counts=counts(lines),
        inspected=any(line.row.asked.inspects for line in lines),
        parts=part_counts(lines),
        shown=lambda line: shown_outcome(line.part, trusted=line.verdict == "accepted"),
        trends=trends_on_page(trends_of(lines)),
        short=_short,
        reasons=partial(_reasons, _folders(lines)),
        rank=VERDICTS.index,
        picture=lambda name: _picture(thumbnails, name),
    )


def counts(lines: Sequence[Line]) -> dict[str, int]:
    """How many rows have which verdict, the good ones first; those that none has are left out."""
    found = Counter(line.verdict for line in lines)
    return {verdict: found[verdict] for verdict in reversed(VERDICTS) if found[verdict]}


class CountedPart(NamedTuple):
    """Parts of one outcome in a count."""

    kind: str  # As `shown_outcome` has it
    words: str


# The good first.
COUNTED = (
    CountedPart("pass", "pass"),
    CountedPart("conditional", "pass on an alignment that is not trusted"),
    CountedPart("undecided", "undecided"),
    CountedPart("fail", "fail"),
)


def part_counts(lines: Sequence[Line]) -> dict[CountedPart, int]:
    """How many parts have which outcome; a pass on an alignment that is not trusted is counted apart."""
    found = Counter(shown_outcome(line.part, trusted=line.verdict == "accepted")["kind"] for line in lines if line.part)
    return {part: found[part.kind] for part in COUNTED if found[part.kind]}


def _folders(lines: Sequence[Line]) -> list[str]:
    """Folders of the files of all rows, the longest first."""
    paths = {path.parent for line in lines for path in (line.row.scan, line.row.target)}
    found = {f"{path}{os.sep}" for each in paths for path in (each, each.absolute())} - {os.sep}
    return sorted(found, key=lambda folder: (-len(folder), folder))


def _reasons(folders: Sequence[str], line: Line) -> list[str]:
    """What is said of a row, with file names without their folders: those are nobody's but the writer's."""
    found = list(line.reasons)
    for folder in folders:
        found = [reason.replace(folder, "") for reason in found]
    return found


def _short(number: float) -> str:
    return "" if math.isnan(number) else f"{number:.3g}"


def _picture(folder: Path | None, name: str) -> str:
    if folder is None:
        return ""
    try:
        return data_uri((folder / f"{name}.jpg").read_bytes(), "jpeg")
    except OSError:
        return ""
