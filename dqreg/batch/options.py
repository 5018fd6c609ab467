"""Options of `dqreg.register` as text: their names, their kinds, and whether they are allowed."""

from __future__ import annotations

import dataclasses
import inspect
from functools import cache
from typing import Any, overload

from dqreg.errors import InputError

# Told by the batch itself, or no text.
NOT_OFFERED = ("observe", "keep_inputs", "tolerance")
# Words that a manifest of old has, and what to write.
RENAMED = {
    "tolerance": "it set when the iterations end, which is convergence now; a tolerance of the part goes to dqreg show"
}
KINDS = {"str": str, "float": float, "int": int, "bool": bool}
WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@cache
def _kinds() -> dict[str, type]:
    """Options that a cell can hold, from the signature of `register`: one that is added there is offered here."""
    from dqreg.register import register

    found = {}
    for name, parameter in inspect.signature(register).parameters.items():
        words = [word.strip() for word in str(parameter.annotation).split("|")]
        kind = next((KINDS[word] for word in words if word in KINDS), None)
        if parameter.kind is parameter.KEYWORD_ONLY and name not in NOT_OFFERED and kind is not None:
            found[name] = kind
    return found


@overload
def option_name(text: str) -> str | None: ...
@overload
def option_name() -> tuple[str, ...]: ...


def option_name(text: str | None = None) -> str | tuple[str, ...] | None:
    """Name of an option as `dqreg.register` has it, from the spelling of a column; without an argument, all names."""
    if text is None:
        return tuple(_kinds())
    name = text.strip().lower().replace("-", "_").replace(" ", "_")
    return next((each for each in (name, f"{name}_deg") if each in _kinds()), None)


def parse_option(name: str, text: str) -> Any:
    """Value of an option from a cell."""
    kind = _kinds()[name]
    try:
        return WORDS[text.lower()] if kind is bool else kind(text)
    except (KeyError, ValueError):
        expected = {float: "a number", int: "a whole number", bool: "yes or no"}[kind]
        raise InputError(f"{name} must be {expected}; got {text!r}") from None


def check_options(options: dict[str, Any]) -> None:
    """Raise unless `dqreg.register` would take these options."""
    from dqreg.geometry.units import factor
    from dqreg.options import Options
    from dqreg.register import register
    from dqreg.solvers import Freedom

    unknown = [name for name in options if name not in _kinds()]
    if unknown:
        if unknown[0] in RENAMED:
            raise InputError(f"the option {unknown[0]} is no more: {RENAMED[unknown[0]]}")
        raise InputError(f"unknown option {unknown[0]!r}; known are {', '.join(_kinds())}")
    defaults = {name: parameter.default for name, parameter in inspect.signature(register).parameters.items()}
    full = {**defaults, **options}
    Options(**{field.name: full[field.name] for field in dataclasses.fields(Options)})
    factor(full["source_units"], full["target_units"])
    if full["dof"] is not None:
        Freedom.parse(full["dof"])
