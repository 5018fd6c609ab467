"""The files of a report: their places are checked before the work, and they are written after all of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqreg.errors import InputError
from dqreg.files.atomic import require_writable, write_atomically
from dqreg.files.strict_json import plain
from dqreg.papers.document import Report, Section
from dqreg.report.html import data_uri, render
from dqreg.report.table import print_tables

if TYPE_CHECKING:
    from rich.console import Console

RESULTS, PAGE = "results.json", "report.html"


def prepare_folder(folder: Path, figure_keys: Sequence[str]) -> None:
    """Make the folder and check that every file can be written in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}; choose another --out") from error
    for name in (RESULTS, PAGE, *(picture_name(key) for key in figure_keys)):
        require_writable(folder / name)


def write_report(report: Report, folder: Path) -> list[Path]:
    """Write the numbers, the figures and the page."""
    from dqreg.papers.drawing import draw_png

    pictures = {figure.key: draw_png(figure) for figure in report.figures}
    contents: dict[str, bytes | str] = {RESULTS: to_json(report)}
    contents |= {picture_name(key): png for key, png in pictures.items()}
    contents[PAGE] = to_html(report, pictures)
    paths = [folder / name for name in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        write_atomically(path, content)
    return paths


def to_html(report: Report, pictures: Mapping[str, bytes]) -> str:
    """Page of a report, with its figures inside."""
    return render("papers.html", report=report, pictures={key: data_uri(png) for key, png in pictures.items()})


def print_section(console: Console, section: Section) -> None:
    """Print the finding, then the tables."""
    from rich.text import Text

    console.print()
    console.print(Text(section.title, style="bold"))
    console.print(Text(section.finding))
    print_tables(console, section.tables)


def to_json(report: Report) -> str:
    """Whole report as strict JSON, every number at full precision."""
    return json.dumps(plain(report), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def picture_name(key: str) -> str:
    """File name of a figure.

    >>> picture_name("weights")
    'figure-weights.png'
    """
    return f"figure-{key}.png"
