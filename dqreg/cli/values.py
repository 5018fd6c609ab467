"""Values of options that click does not know: a scale, a tolerance with two sides."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dqreg.inspection import Tolerance

    Scale = click.ParamType[float | str]
    Limits = click.ParamType[float | Tolerance]
else:
    # The types of an older click take no brackets when the program runs.
    Scale = Limits = click.ParamType

NUMBER = r"(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)"
SIDES = re.compile(rf"([-+]?){NUMBER}/([-+]?){NUMBER}")


class ScaleType(Scale):
    """A factor above 0, or "solve"."""

    name = "scale"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """The number or the word that a text means."""
        if value == "solve":
            return "solve"
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither solve nor a number", param, ctx)


class ToleranceType(Limits):
    """A length for both sides, or two signed ones, the upper first: +0.2/-0.05, +0.2/0."""

    name = "tolerance"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | Tolerance:
        """The length, or the limits, that a text means."""
        found = SIDES.fullmatch(str(value))
        if found is None:
            try:
                return float(value)
            except ValueError:
                self.fail(f"{value!r} is neither a length nor two sides such as +0.2/-0.05", param, ctx)
        from dqreg.inspection import Tolerance

        high, low = (float(sign + number) for sign, number in (found.group(1, 2), found.group(3, 4)))
        return Tolerance(low, high)
