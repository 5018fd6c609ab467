"""What a reproduction says, as plain data: computed once, then shown on the screen, as JSON and as a page.

A report holds sections; a section holds sentences, tables and figures. A figure is its curves, so that the numbers
behind every line stand in the JSON as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Estimate:
    """A simulated number with its Monte-Carlo standard error.

    Attributes
    ----------
    value : float
        The estimate.
    error : float
        One standard error, in the same unit.
    """

    value: float
    error: float


Cell: TypeAlias = float | int | str | Estimate | None


@dataclass(frozen=True, slots=True)
class Column:
    """Head of a column.

    Attributes
    ----------
    name : str
        What stands below.
    unit : str
        Unit of the numbers; empty for counts, ratios and words.
    spec : str
        Format of plain floats, as in `format`.
    """

    name: str
    unit: str = ""
    spec: str = ".3g"

    @property
    def head(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of numbers and words.

    Attributes
    ----------
    key : str
        Name in the JSON.
    title : str
        What the table shows.
    columns : tuple of Column
        Heads.
    rows : tuple of tuple
        One cell a column; None is an empty cell.
    note : str
        What a reader must know to read it.
    """

    key: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.key}: a row has {len(row)} cells, the head {len(self.columns)}")


@dataclass(frozen=True, slots=True)
class Curve:
    """One line or row of markers.

    Attributes
    ----------
    label : str
        Entry of the legend; empty for none.
    x, y : tuple of float
        The points.
    errors : tuple of float
        Half the height of the error bars; empty for none.
    colour : int
        Number in the palette.
    line, marker : str
        Matplotlib's signs; empty for none.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    errors: tuple[float, ...] = ()
    colour: int = 0
    line: str = "-"
    marker: str = ""


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    x_label, y_label : str
        Quantity and unit.
    curves : tuple of Curve
        What is drawn.
    title : str
        Above the axes.
    log_x, log_y : bool
        Logarithmic axes.
    y_limits : tuple of float, optional
        Lowest and highest y shown.
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    y_limits: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """Panels below each other, so that they can be read on a phone.

    Attributes
    ----------
    key : str
        Name in the JSON and of the PNG file.
    title : str
        What it shows; also the text for those who cannot see it.
    panels : tuple of Panel
        From top to bottom.
    note : str
        How to read it.
    """

    key: str
    title: str
    panels: tuple[Panel, ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """One question and its answer.

    Attributes
    ----------
    key : str
        Name in the JSON.
    title : str
        Heading.
    finding : str
        The answer in one or two sentences.
    text : tuple of str
        How it was measured, a paragraph each.
    tables : tuple of Table
        Numbers.
    figures : tuple of Figure
        Curves.
    """

    key: str
    title: str
    finding: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that `dqreg reproduce` found out about one paper.

    Attributes
    ----------
    paper : str
        Short name.
    title : str
        Heading of the page.
    citation : str
        What was reproduced.
    seed : int
        Seed of all draws.
    quick : bool
        Whether fewer trials were drawn than a full run draws.
    sections : tuple of Section
        Questions and answers.
    versions : dict
        Versions of what computed it, and the machine.
    """

    paper: str
    title: str
    citation: str
    seed: int
    quick: bool
    sections: tuple[Section, ...]
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Figures of all sections."""
        return tuple(figure for section in self.sections for figure in section.figures)


def floats(values: Iterable[float]) -> tuple[float, ...]:
    """Plain Python numbers of any array, for curves and rows.

    Parameters
    ----------
    values : iterable of float
        Numbers, for example an array.

    Returns
    -------
    tuple of float
        The same numbers.

    Examples
    --------
    >>> import numpy as np
    >>> floats(np.arange(3))
    (0.0, 1.0, 2.0)
    """
    return tuple(float(value) for value in values)
