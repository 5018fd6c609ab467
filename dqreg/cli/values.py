"""Values of options: a file, a unit of length, a scale, a viewpoint, a tolerance with two sides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import click

from dqreg.cli.lazy_group import Choice, SectionedCommand, spelling
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.inspection import Tolerance

    Scale = click.ParamType[float | str]
    Limits = click.ParamType[float | Tolerance]
    Place = click.ParamType[tuple[float, ...] | Literal["none"]]
else:
    # The types of an older click take no brackets when the program runs.
    Scale = Limits = Place = click.ParamType

FILE = click.Path(path_type=Path)
# Where the scanner stood: the words for using no place of it, and for that of the coordinates' own origin.
PLACE = "--viewpoint"
NO_PLACE: Final = "none"
ORIGIN = "origin"


class UnitType(Choice):
    """A length unit; usual spellings get the one that was meant."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """What is said of a unit that is not known."""
        from dqreg.files.units import unit_meant

        return f"{str(value)!r} is not one of {', '.join(self.choices)}{unit_meant(str(value), self.choices)}"


# The same as in the library, which a test compares.
UNITS = UnitType(["um", "mm", "cm", "m", "inch", "ft"])


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
    """A command whose --viewpoint takes one word, or three coordinates that stand apart."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        words, left = list[str](), list(args)
        while left and left[0] != "--":
            word, equals, place = left.pop(0).partition("=")
            if spelling(word) != PLACE:
                words.append(word + equals + place)
            elif equals or left:
                first = place if equals else left.pop(0)
                words.append(f"{PLACE}={' '.join([first, *_popped(left, 2 if _is_number(first) else 0)])}")
            else:
                words.append(word)
        return super().parse_args(ctx, words + left)


def _popped(words: list[str], count: int) -> list[str]:
    return [words.pop(0) for _ in words[:count]]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


class PlaceType(Place):
    """A place as "X Y Z" or "X,Y,Z", "origin", or the word none, which says that none is used."""

    name = "place"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...] | Literal["none"]:
        """The place or the word that a text means."""
        if value == NO_PLACE:
            return NO_PLACE
        words = ["0"] * 3 if value == ORIGIN else str(value).replace(",", " ").split()
        if len(words) != 3 or not all(map(_is_number, words)):
            self.fail(
                f"{str(value)!r} is neither three numbers X Y Z (or X,Y,Z) nor {ORIGIN} nor {NO_PLACE}", param, ctx
            )
        return tuple(map(float, words))


def places_of(
    given: tuple[tuple[float, ...] | Literal["none"], ...],
) -> tuple[tuple[float, ...], ...] | Literal["none"] | None:
    """Viewpoints that were given: places, the word none, or None.

    >>> places_of(((0.0, 0.0, 5.0),)), places_of(("none",)), places_of(())
    (((0.0, 0.0, 5.0),), 'none', None)
    """
    places = tuple(place for place in given if place != NO_PLACE)
    if len(places) < len(given):
        if len(given) > 1:
            raise InputError(f"{PLACE} {NO_PLACE} stands alone: leave it out, or the places")
        return NO_PLACE
    return places or None


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
