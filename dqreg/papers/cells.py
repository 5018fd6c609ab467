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
        What the cell holds. An estimate shows its standard error in brackets, in units of its last digits.
    column : Column
        Its head, which says how plain floats are written.

    Returns
    -------
    str
        The text, without the unit.

    Examples
    --------
    >>> cell_text(Estimate(0.123456, 0.00123), Column("angle", "deg"))
    '0.1235(12)'
    >>> cell_text(Estimate(4.2e-5, 3.1e-7), Column("angle", "rad"))
    '4.200(31)e-5'
    >>> cell_text(3.2e-12, Column("error")), cell_text(None, Column("error")), cell_text(7, Column("count"))
    ('3.2e-12', '-', '7')
    """
    if cell is None:
        return EMPTY
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, Estimate):
        return _estimate_text(cell, column)
    return short_number(cell, column.spec) if math.isfinite(cell) else EMPTY


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


def short_number(value: float, spec: str = "g") -> str:
    """Number without the padding of exponents.

    Parameters
    ----------
    value : float
        A finite number.
    spec : str
        Format, as in `format`.

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> short_number(1e-5), short_number(1e12), short_number(0.0, ".1e")
    ('1e-5', '1e12', '0')
    """
    text = format(value, spec) if value else "0"
    text = re.sub(r"e([+-])0*(\d)", lambda found: "e" + found[1].replace("+", "") + found[2], text)
    return text.removesuffix("e0")


def _estimate_text(cell: Estimate, column: Column) -> str:
    if not math.isfinite(cell.value):
        return EMPTY
    if not (math.isfinite(cell.error) and cell.error > 0.0):
        return short_number(cell.value, column.spec)
    exponent = math.floor(math.log10(abs(cell.value))) if cell.value else 0
    # Numbers below a ten-thousandth are written with a power of ten.
    shift = exponent if exponent < -4 else 0
    value, error = cell.value / 10.0**shift, cell.error / 10.0**shift
    decimals = max(0, 1 - math.floor(math.log10(error)))
    bracket = f"{error:.{decimals}f}" if error >= 1.0 else str(round(error * 10**decimals))
    return f"{value:.{decimals}f}({bracket})" + (f"e{shift}" if shift else "")
