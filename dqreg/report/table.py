"""One table for every place that shows one: numbers and words in, terminal, Markdown, CSV or page out.

A page shows it with the macro of ``templates/table.html``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from dqreg.errors import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

EMPTY = "-"
# Width to which a column of words is squeezed before the columns after it go below.
NARROWEST_WORDS = 24


@dataclass(frozen=True, slots=True)
class Estimate:
    """A simulated number with its Monte-Carlo standard error."""

    value: float
    error: float  # One standard error, in the same unit


Cell: TypeAlias = float | int | str | Estimate | None


@dataclass(frozen=True, slots=True)
class Column:
    """Head of a column."""

    name: str
    unit: str = ""  # Unit of the numbers; empty for counts, ratios and words
    spec: str = ".3g"  # Format of plain floats, as in `format`
    align: Literal["auto", "left", "right"] = "auto"  # Auto: numbers to the right, words to the left
    wraps: bool = False  # Whether its words may go on in the next line

    @property
    def head(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of numbers and words."""

    key: str  # Names it in files
    title: str  # What it shows
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]  # One cell a column; None is an empty cell
    note: str = ""  # What a reader must know to read it

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.key}: a row has {len(row)} cells, the head {len(self.columns)}")

    @property
    def head(self) -> tuple[str, ...]:
        """Heads of the columns."""
        return tuple(column.head for column in self.columns)

    @property
    def text(self) -> tuple[tuple[str, ...], ...]:
        """Cells as text."""
        return tuple(tuple(map(cell_text, row, self.columns)) for row in self.rows)

    def is_right(self, index: int) -> bool:
        """Whether a column is set to the right, as numbers are."""
        align = self.columns[index].align
        if align != "auto":
            return align == "right"
        return bool(self.rows) and not isinstance(self.rows[0][index], str)

    def wraps(self, index: int) -> bool:
        """Whether the words of a column may go on in the next line; a number is never cut."""
        return self.columns[index].wraps or (index > 0 and not self.is_right(index))


def cell_text(cell: Cell, column: Column) -> str:
    """Text of a cell."""
    if cell is None:
        return EMPTY
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, Estimate):
        return _estimate_text(cell, column)
    return short_number(cell, column.spec) if math.isfinite(cell) else EMPTY


def short_number(value: float, spec: str = "g") -> str:
    """Number without the padding of exponents."""
    text = format(value, spec) if value else "0"
    text = re.sub(r"e([+-])0*(\d)", lambda found: "e" + found[1].replace("+", "") + found[2], text)
    return text.removesuffix("e0")


def _estimate_text(cell: Estimate, column: Column) -> str:
    if not math.isfinite(cell.value):
        return EMPTY
    # An error below the digits of a float is none.
    if not (math.isfinite(cell.error) and cell.error > 1e-15 * abs(cell.value)):
        return short_number(cell.value, column.spec)
    exponent = math.floor(math.log10(abs(cell.value))) if cell.value else 0
    # Numbers below a ten-thousandth are written with a power of ten.
    shift = exponent if exponent < -4 else 0
    value, error = cell.value / 10.0**shift, cell.error / 10.0**shift
    decimals = max(0, 1 - math.floor(math.log10(error)))
    bracket = f"{error:.{decimals}f}" if error >= 1.0 else str(round(error * 10**decimals))
    return f"{value:.{decimals}f}({bracket})" + (f"e{shift}" if shift else "")


def to_markdown(tables: Sequence[Table], note: str = "") -> str:
    """Tables as Markdown, with what would break one escaped, and a note below."""
    parts = []
    for table in tables:
        rows = ["| " + " | ".join(_escaped(cell) for cell in row) + " |" for row in (table.head, *table.text)]
        rule = "|" + "".join("--:|" if table.is_right(index) else "---|" for index in range(len(table.head)))
        parts.append("\n".join([f"### {_escaped(table.title)}", "", rows[0], rule, *rows[1:], ""]))
        if table.note:
            parts.append(f"{table.note}\n")
    return "\n".join([*parts, note + "\n"] if note else parts)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")


def print_tables(console: Console, tables: Sequence[Table]) -> None:
    """Show tables on a terminal or in a pipe."""
    from rich.text import Text

    for table in tables:
        if table.title:
            console.print()
            console.print(Text(printable(table.title), style="bold"), soft_wrap=True)
        for columns in _that_fit(table, console.width):
            console.print(_shown(table, columns, terminal=console.is_terminal))
        if table.note:
            console.print(Text(_lines(table.note), style="dim"))


def _shown(table: Table, columns: Sequence[int], *, terminal: bool) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(box=box.SIMPLE_HEAD if terminal else None, pad_edge=False)
    for index in columns:
        justify: Literal["left", "right"] = "right" if table.is_right(index) else "left"
        head = Text(_lines(table.head[index]))
        shown.add_column(head, justify=justify, overflow="fold", no_wrap=not table.wraps(index))
    for row in table.text:
        shown.add_row(*(Text(_lines(row[index])) for index in columns))
    return shown


def _lines(text: str) -> str:
    # Names of files and engines are among the words.
    return "\n".join(map(printable, text.split("\n")))


def _that_fit(table: Table, width: int) -> list[list[int]]:
    """Columns in groups that fit the screen, each with the first in front: a digit must never be cut off."""
    rows = (table.head, *table.text)
    widths = [max(len(line) for row in rows for line in row[index].split("\n")) + 2 for index in range(len(table.head))]
    groups: list[list[int]] = []
    used = width + 1
    for index in range(1, len(widths)):
        needed = min(widths[index], NARROWEST_WORDS) if table.wraps(index) else widths[index]
        if used + needed > width:
            groups.append([0])
            used = widths[0]
        groups[-1].append(index)
        used += needed
    return groups or [[0]]
