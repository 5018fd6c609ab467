"""A choice of words that names the nearest one where none fits."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

import click


class Choice(click.Choice[str]):
    """Like `click.Choice`, in one short sentence, with the word that was probably meant.

    >>> Choice(["auto", "plane"]).convert("plan", None, None)
    Traceback (most recent call last):
    ...
    click.exceptions.BadParameter: 'plan' is not one of auto, plane. Did you mean plane?
    """

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """What is said of a word that is not known."""
        return f"{str(value)!r} is not one of {', '.join(self.choices)}.{meant(str(value), self.choices)}"


def meant(word: str, known: Iterable[str]) -> str:
    """A question that names the known word that is nearest, or nothing."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" Did you mean {near[0]}?" if near else ""
