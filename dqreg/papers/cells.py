"""A cell as text: one wording for the screen and the page."""

from __future__ import annotations

import math
import re

from dqreg.papers.document import Cell, Column, Estimate

EMPTY = "-"


def cell_text(cell: Cell, column: Column) -> str:
    """Text of a cell.

    Parameters
    ----------
    cell : float, int, str, Estimate or None
        What the cell holds. An estimate is rounded to two digits of its standard error.
    column : Column
        Its head, which says how plain floats are written.

    Returns
    -------
    str
        The text, without the unit.

    Examples
    --------
    >>> cell_text(Estimate(0.123456, 0.00123), Column("angle", "deg"))
    '0.1235 ± 0.0012'
    >>> cell_text(3.2e-12, Column("error")), cell_text(None, Column("error")), cell_text(7, Column("count"))
    ('3.2e-12', '-', '7')
    """
    if cell is None:
        return EMPTY
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, Estimate):
        return _estimate_text(cell, column)
    return _short(format(cell, column.spec)) if math.isfinite(cell) else EMPTY


def is_number(cell: Cell) -> bool:
    """Whether a cell is set to the right, as numbers are.

    Parameters
    ----------
    cell : float, int, str, Estimate or None
        What the cell holds.

    Returns
    -------
    bool
        False for words only.

    Examples
    --------
    >>> is_number(1.5), is_number("refused")
    (True, False)
    """
    return not isinstance(cell, str)


def _estimate_text(cell: Estimate, column: Column) -> str:
    if not math.isfinite(cell.value):
        return EMPTY
    if not (math.isfinite(cell.error) and cell.error > 0.0):
        return _short(format(cell.value, column.spec))
    decimals = 1 - math.floor(math.log10(cell.error))
    if not 0 <= decimals <= 6:
        return f"{_short(format(cell.value, '.3g'))} ± {_short(format(cell.error, '.2g'))}"
    return f"{cell.value:.{decimals}f} ± {cell.error:.{decimals}f}"


def _short(text: str) -> str:
    # 1e-05 becomes 1e-5.
    return re.sub(r"e([+-])0*(\d)", lambda found: "e" + found[1].replace("+", "") + found[2], text)
