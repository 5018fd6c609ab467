"""A cell as text: one wording for the screen and the page."""

from __future__ import annotations

import math
import re

from dqreg.papers.document import Cell, Column, Estimate

EMPTY = "-"


def cell_text(cell: Cell, column: Column) -> str:
    """Text of a cell."""
    if cell is None:
        return EMPTY
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, Estimate):
        return _estimate_text(cell, column)
    return short_number(cell, column.spec) if math.isfinite(cell) else EMPTY


def is_number(cell: Cell) -> bool:
    """Whether a cell is set to the right, as numbers are.

    >>> is_number(1.5), is_number("refused")
    (True, False)
    """
    return not isinstance(cell, str)


def short_number(value: float, spec: str = "g") -> str:
    """Number without the padding of exponents.

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
