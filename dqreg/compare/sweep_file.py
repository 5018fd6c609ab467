"""A sweep as a text file, read with care."""

from __future__ import annotations

import dataclasses
import importlib.resources
import os
import tomllib
from pathlib import Path
from typing import Any, get_args

from dqreg._numbers import is_number, is_whole
from dqreg.compare.engines.protocol import Setting
from dqreg.compare.sweep import FRAMES, AxisName, Cell, Sweep, SweepAxis
from dqreg.errors import InputError, did_you_mean
from dqreg.files.untrusted import read_record
from dqreg.synth.parts import KINDS

# Sweeps by name; the last is no file.
SHIPPED, TRUST = ("standard", "quick"), "trust"


def read_sweep(name: str | os.PathLike[str]) -> Sweep:
    """Read a sweep."""
    if str(name) in SHIPPED:
        text = importlib.resources.files("dqreg.compare").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    else:
        path = Path(name)
        if not path.is_file():
            hint = did_you_mean(path.stem, (*SHIPPED, TRUST))
            raise InputError(
                f"--sweep must be {', '.join(SHIPPED)}, {TRUST} or a TOML file; there is no file {str(name)!r}{hint}"
            )
        text = read_record(path, "a sweep (TOML)")
    return parse_sweep(text, str(name))


def parse_sweep(text: str, name: str) -> Sweep:
    """Sweep of TOML text with ``[base]``, one table for each axis, ``timeout`` and ``engines``."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"sweep {name}: not TOML: {error}") from error
    if "scanner" in data:
        raise InputError(f"{name} is a recipe, not a sweep; give it as CASE, without --sweep")
    _known(data, ("base", "axis", "timeout", "title", "engines"), f"sweep {name}: ")
    base = _table(data, "base", name)
    fields = {field.name for field in dataclasses.fields(Cell)} - {"axis", "value", "trial", "setting", "nothing"}
    _known(base, fields, f"sweep {name}: base.")
    axes = tuple(_axis(key, table, name) for key, table in _table(data, "axis", name).items())
    if not axes:
        raise InputError(f"sweep {name}: give at least one axis, like [axis.noise] with values = [0.0, 1e-3]")
    engines = _names(data.get("engines", []), f"sweep {name}: engines")
    timeout = _positive(data.get("timeout", 60.0), f"{name}: timeout")
    sweep = Sweep(str(data.get("title", name)), base, axes, timeout, engines)
    for cell, _ in sweep.cells():
        _check(cell, name)
    return sweep


def _axis(key: str, table: Any, name: str) -> SweepAxis:
    where = f"sweep {name}: axis.{key}"
    _known({key: None}, get_args(AxisName), f"sweep {name}: axis.")
    if not isinstance(table, dict):
        raise InputError(f"{where} must be a table, [axis.{key}]")
    _known(table, ("values", "trials", "settings", "repeats", "more_engines"), f"{where}.")
    values, settings = table.get("values"), table.get("settings", ["manual"])
    if not isinstance(values, list) or not values:
        raise InputError(f"{where}.values must be a list of one or more values; got {values!r}")
    if not isinstance(settings, list) or not settings or not set(settings) <= set(get_args(Setting)):
        raise InputError(f"{where}.settings must be a list of {', '.join(get_args(Setting))}; got {settings!r}")
    if key == "nothing" and "same-loop" in settings:
        raise InputError(f"{where}.settings: the same loop needs a start, and this axis has none")
    counts = {word: table.get(word, 1) for word in ("trials", "repeats")}
    for word, count in counts.items():
        if not is_whole(count) or count < 1:
            raise InputError(f"{where}.{word} must be a whole number above 0; got {count!r}")
    more = _names(table.get("more_engines", []), f"{where}.more_engines")
    return SweepAxis(key, tuple(values), settings=tuple(settings), more_engines=more, **counts)


def _check(cell: Cell, name: str) -> None:
    where = f"sweep {name}: "
    for word in ("part", "nothing"):
        if (value := getattr(cell, word)) not in ("", *KINDS):
            raise InputError(f"{where}{word} must be one of {', '.join(KINDS)}; got {value!r}")
    if cell.frame not in FRAMES:
        raise InputError(f"{where}frame must be one of {', '.join(FRAMES)}; got {cell.frame!r}")
    if not is_whole(cell.points) or cell.points < 100:
        raise InputError(f"{where}points must be a whole number, 100 or more; got {cell.points!r}")
    for word, high in (("start_angle_deg", 180.0), ("start_offset", 10.0), ("noise", 1.0), ("outliers", 0.9)):
        _between(getattr(cell, word), 0.0, high, where + word)
    if cell.overlap is not None:
        _between(cell.overlap, 0.05, 1.0, where + "overlap")


def _names(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(word, str) for word in value):
        raise InputError(f"{where} must be a list of names; got {value!r:.80}")
    return tuple(value)


def _known(table: Any, known: Any, prefix: str) -> None:
    for key in table:
        if key not in known:
            hint = did_you_mean(key, known) or f"; known here: {', '.join(sorted(known))}"
            raise InputError(f"{prefix}{key} is not known{hint}")


def _table(data: Any, key: str, name: str) -> dict[str, Any]:
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"sweep {name}: {key} must be a table; got {table!r}")
    return table


def _positive(value: Any, name: str) -> float:
    if not is_number(value) or not 0.0 < value < 1e300:
        raise InputError(f"sweep {name} must be a number above 0; got {value!r:.60}")
    return float(value)


def _between(value: Any, low: float, high: float, name: str) -> None:
    if not is_number(value) or not low <= value <= high:
        raise InputError(f"{name} must lie between {low:g} and {high:g}; got {value!r}")
