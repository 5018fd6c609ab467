"""What a reproduction says, as plain data: computed once, then shown on the screen, as JSON and as a page.

A report holds sections; a section holds sentences, tables and figures. A figure is its curves, so that the numbers
behind every line stand in the JSON as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from dqreg.report.table import Table


@dataclass(frozen=True, slots=True)
class Curve:
    """One line or row of markers."""

    label: str  # Entry of the legend; empty for none
    # x, y: The points
    x: tuple[float, ...]
    y: tuple[float, ...]
    errors: tuple[float, ...] = ()  # Half the height of the error bars; empty for none
    colour: int = 0  # Number in the palette
    # line, marker: Matplotlib's signs; empty for none
    line: str = "-"
    marker: str = ""


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes."""

    # x_label, y_label: Quantity and unit
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]  # What is drawn
    title: str = ""  # Above the axes
    # log_x, log_y: Logarithmic axes
    log_x: bool = False
    log_y: bool = False
    y_limits: tuple[float, float] | None = None  # Lowest and highest y shown


@dataclass(frozen=True, slots=True)
class Figure:
    """Panels below each other, so that they can be read on a phone."""

    key: str  # Name in the JSON and of the PNG file
    title: str  # What it shows; also the text for those who cannot see it
    panels: tuple[Panel, ...]  # From top to bottom
    note: str = ""  # How to read it


@dataclass(frozen=True, slots=True)
class Section:
    """One question and its answer."""

    key: str  # Name in the JSON
    title: str  # Heading
    finding: str  # The answer in one or two sentences
    text: tuple[str, ...] = ()  # How it was measured, a paragraph each
    tables: tuple[Table, ...] = ()  # Numbers
    figures: tuple[Figure, ...] = ()  # Curves


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that `dqreg reproduce` found out about one paper."""

    paper: str  # Short name
    title: str  # Heading of the page
    citation: str  # What was reproduced
    seed: int  # Seed of all draws
    quick: bool  # Whether fewer trials were drawn than a full run draws
    sections: tuple[Section, ...]  # Questions and answers
    versions: dict[str, str] = field(default_factory=dict)  # Versions of what computed it, and the machine

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Figures of all sections."""
        return tuple(figure for section in self.sections for figure in section.figures)


def floats(values: Iterable[float]) -> tuple[float, ...]:
    """Plain Python numbers of any array, for curves and rows."""
    return tuple(float(value) for value in values)
