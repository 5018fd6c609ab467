"""What ``--scale`` takes: a number, or the word that asks for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    Base = click.ParamType[float | str]
else:
    # The types of an older click take no brackets when the program runs.
    Base = click.ParamType


class ScaleType(Base):
    """A factor above 0, or "solve".

    >>> ScaleType().convert("solve", None, None), ScaleType().convert("25.4", None, None)
    ('solve', 25.4)
    """

    name = "scale"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """The number or the word that a text means."""
        if value == "solve":
            return "solve"
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither solve nor a number", param, ctx)
