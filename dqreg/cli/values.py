"""Values of options: a file, a unit of length, a scale, a tolerance with two sides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.lazy_group import Choice
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.inspection import Tolerance

    Scale = click.ParamType[float | str]
    Limits = click.ParamType[float | Tolerance]
else:
    # The types of an older click take no brackets when the program runs.
    Scale = Limits = click.ParamType

FILE = click.Path(path_type=Path)


class UnitType(Choice):
    """A length unit; usual spellings get the one that was meant."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """What is said of a unit that is not known."""
        from dqreg.files.units import unit_meant

        return f"{str(value)!r} is not one of {', '.join(self.choices)}{unit_meant(str(value), self.choices)}"


UNITS = UnitType(["mm", "cm", "m", "inch", "ft"])


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
    """A length for both sides, or two signed ones: +0.2/-0.05, -0.05/+0.2, +0.2/0."""

    name = "tolerance"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | Tolerance:
        """The length, or the limits, that a text means."""
        from dqreg.inspection.tolerances import tolerance_from

        try:
            # Click's own words for what is no text of a tolerance; a tolerance that cannot be has its own.
            return tolerance_from(str(value))
        except InputError as error:
            self.fail(str(error), param, ctx)
