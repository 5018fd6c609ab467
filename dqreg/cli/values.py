"""Values of options: a file, a unit of length, a scale, a viewpoint, a tolerance with two sides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.lazy_group import Choice, SectionedCommand
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.inspection import Tolerance

    Scale = click.ParamType[float | str]
    Limits = click.ParamType[float | Tolerance]
    Coordinate = click.ParamType[float | str]
else:
    # The types of an older click take no brackets when the program runs.
    Scale = Limits = Coordinate = click.ParamType

FILE = click.Path(path_type=Path)
# Where the scanner stood, and the word for using no place of it.
PLACE = "--viewpoint"
NO_PLACE = "none"


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


class PlaceCommand(SectionedCommand):
    """A command whose --viewpoint takes the word none in place of three coordinates."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        words: list[str] = []
        for word in args:
            if word == f"{PLACE}={NO_PLACE}":
                words += [PLACE, *[NO_PLACE] * 3]
            else:
                words += [word] * (3 if word == NO_PLACE and words[-1:] == [PLACE] else 1)
        return super().parse_args(ctx, words)


class CoordinateType(Coordinate):
    """A number, or the word none, which stands for all three."""

    name = "coordinate"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """The number or the word that a text means."""
        if value == NO_PLACE:
            return NO_PLACE
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor {NO_PLACE}", param, ctx)


def places_of(given: tuple[tuple[float | str, ...], ...]) -> tuple[tuple[float | str, ...], ...] | str | None:
    """Viewpoints that were given: places, the word none, or None.

    >>> places_of(((0.0, 0.0, 5.0),)), places_of((("none",) * 3,)), places_of(())
    (((0.0, 0.0, 5.0),), 'none', None)
    """
    if any(NO_PLACE in place for place in given):
        if len(given) > 1 or set(given[0]) != {NO_PLACE}:
            raise InputError(f"{PLACE} {NO_PLACE} stands alone: leave it out, or the places")
        return NO_PLACE
    return given or None


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
