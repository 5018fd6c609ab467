"""The tables on a screen, as Markdown and as CSV, and the sentences under them."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dqreg.compare.run import Comparison
from dqreg.compare.summary import SummaryRow
from dqreg.compare.tables import REMARK, Table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable


def markdown(made: Sequence[Table], note: str = "") -> str:
    """Tables as Markdown, with what would break one escaped, and a note below."""
    parts = []
    for table in made:
        rows = ["| " + " | ".join(_escaped(cell) for cell in row) + " |" for row in (table.head, *table.rows)]
        rule = "|---|" + "--:|" * (len(table.head) - 1)
        parts.append("\n".join([f"### {_escaped(table.title)}", "", rows[0], rule, *rows[1:], ""]))
        if table.note:
            parts.append(f"{table.note}\n")
    return "\n".join([*parts, note + "\n"] if note else parts)


def to_csv(lines: Sequence[SummaryRow]) -> str:
    """Every line of the summary at full precision."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    places = ("case", "axis", "value", "setting", "from_nothing")
    numbers = [
        field.name for field in dataclasses.fields(SummaryRow) if field.name not in ("engine", "place", "timed_out")
    ]
    writer.writerow(["engine", *places, *numbers])
    for line in lines:
        where = [getattr(line.place, name) for name in places]
        writer.writerow([line.engine, *where, *(getattr(line, name) for name in numbers)])
    return buffer.getvalue()


def print_tables(console: Console, made: Sequence[Table]) -> None:
    """Show tables on a terminal or in a pipe."""
    from rich.text import Text

    for table in made:
        console.print()
        console.print(Text(table.title, style="bold"), soft_wrap=True)
        for columns in _that_fit(table, console.width):
            console.print(_shown(table, columns, terminal=console.is_terminal))
        if table.note and console.is_terminal:
            console.print(Text(table.note, style="dim"))


def _shown(table: Table, columns: Sequence[int], *, terminal: bool) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(box=box.SIMPLE_HEAD if terminal else None, pad_edge=False)
    for index in columns:
        words = index == 0 or table.head[index] == REMARK
        shown.add_column(Text(table.head[index]), justify="left" if words else "right", overflow="fold",
                         no_wrap=table.head[index] != REMARK)  # fmt: skip
    for row in table.rows:
        shown.add_row(*(Text(row[index]) for index in columns))
    return shown


def _that_fit(table: Table, width: int) -> list[list[int]]:
    """Columns in groups that fit the screen, each with the engine in front: a digit must never be cut off."""
    widths = [max(len(row[index]) for row in (table.head, *table.rows)) + 2 for index in range(len(table.head))]
    groups: list[list[int]] = []
    used = width + 1
    for index in range(1, len(widths)):
        # Remarks may go on in the next line.
        needed = min(widths[index], 24) if table.head[index] == REMARK else widths[index]
        if used + needed > width:
            groups.append([0])
            used = widths[0]
        groups[-1].append(index)
        used += needed
    return groups or [[0]]


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
    ]
    if found.missing:
        missing = "; ".join(f"{name} (pip install {' '.join(needs)})" for name, needs in found.missing.items())
        text.append(f"Not installed: {missing}.")
    return " ".join(text)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")
