"""Options of `dqreg.register` in the cells of a manifest: how each is spelled, read and checked."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Callable
from typing import Any, overload

from dqreg.errors import InputError

# Words that a manifest of old has, and what to write.
RENAMED = {
    "tolerance": "it set when the iterations end, which is convergence now; the column tolerance is that of the part"
}
WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclasses.dataclass(frozen=True)
class OptionKind:
    """How a cell is read as the value of an option; what it cannot read raises `KeyError` or `ValueError`."""

    parse: Callable[[str], Any]
    expected: str = "text"


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("no number of a result")
    return value


def _scale(text: str) -> float | str:
    return text if text == "solve" else _finite(text)


def _viewpoints(text: str) -> list[list[float]] | str:
    from dqreg.registration.options.options import NO_VIEWPOINT, ORIGIN

    if text in (NO_VIEWPOINT, ORIGIN):
        return text
    found = [[_finite(word) for word in place.replace(",", " ").split()] for place in text.split(";")]
    if any(len(place) != 3 for place in found):
        raise ValueError("no places")
    return found


TEXT, NUMBER = OptionKind(str), OptionKind(_finite, "a finite number")
WHOLE, FLAG = OptionKind(int, "a whole number"), OptionKind(lambda text: WORDS[text.lower()], "yes or no")
# Options of `register` that a cell can hold.
OPTIONS = {
    "method": TEXT,
    "max_distance": NUMBER,
    "max_angle_deg": NUMBER,
    "source_units": TEXT,
    "target_units": TEXT,
    "effort": TEXT,
    "seed": WHOLE,
    "accelerate": FLAG,
    "max_iterations": WHOLE,
    "convergence": NUMBER,
    "units": TEXT,
    "dof": TEXT,
    "time_limit": NUMBER,
    "scale": OptionKind(_scale, "a finite number or the word solve"),
    "viewpoint": OptionKind(_viewpoints, "three numbers x y z, of several places with ; between them, or none"),
    "search": TEXT,
    "clutter": TEXT,
    "expected_deviation": NUMBER,
}
# And those that it cannot: what the batch says itself, and what is no text.
NOT_OFFERED = ("prior", "observe", "observe_search", "keep_inputs", "verdict", "tolerance")


@overload
def option_name(text: str) -> str | None: ...
@overload
def option_name() -> tuple[str, ...]: ...


def option_name(text: str | None = None) -> str | tuple[str, ...] | None:
    """Name of an option as `dqreg.register` has it, from the spelling of a column; without an argument, all names."""
    if text is None:
        return tuple(OPTIONS)
    name = text.strip().lower().replace("-", "_").replace(" ", "_")
    return next((each for each in (name, f"{name}_deg") if each in OPTIONS), None)


def parse_option(name: str, text: str) -> Any:
    """Value of an option from a cell."""
    kind = OPTIONS[name]
    try:
        return kind.parse(text)
    except (KeyError, ValueError):
        raise InputError(f"{name} must be {kind.expected}; got {text!r:.100}") from None


def check_options(options: dict[str, Any]) -> None:
    """Raise unless `dqreg.register` would take these options."""
    from dqreg.files.units import factor
    from dqreg.registration.options.options import Options
    from dqreg.registration.register import register
    from dqreg.solvers import Freedom

    unknown = [name for name in options if name not in OPTIONS]
    if unknown:
        if unknown[0] in RENAMED:
            raise InputError(f"the option {unknown[0]} is no more: {RENAMED[unknown[0]]}")
        raise InputError(f"unknown option {unknown[0]!r}; known are {', '.join(OPTIONS)}")
    defaults = {name: parameter.default for name, parameter in inspect.signature(register).parameters.items()}
    full = {**defaults, **options}
    Options(**{field.name: full[field.name] for field in dataclasses.fields(Options)})
    factor(full["source_units"], full["target_units"])
    if full["dof"] is not None:
        Freedom.parse(full["dof"])
