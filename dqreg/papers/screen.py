"""A report on the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dqreg.papers.cells import cell_text, is_number
from dqreg.papers.document import Section, Table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable


def print_section(console: Console, section: Section) -> None:
    """Print the finding, then the tables."""
    from rich.text import Text

    console.print()
    console.print(Text(section.title, style="bold"))
    console.print(Text(section.finding))
    for table in section.tables:
        console.print(_rich_table(table))
        if table.note:
            console.print(Text(table.note, style="dim"))


def _rich_table(table: Table) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    # Where the terminal is narrow, numbers go on in the next line; a digit must never be cut off.
    shown = RichTable(title=Text(table.title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(table.columns):
        right = bool(table.rows) and is_number(table.rows[0][index])
        shown.add_column(Text(column.head), justify="right" if right else "left", overflow="fold")
    for row in table.rows:
        shown.add_row(*(Text(cell_text(cell, column)) for cell, column in zip(row, table.columns, strict=True)))
    return shown
