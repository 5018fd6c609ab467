"""All kinds of task by name."""

from __future__ import annotations

from collections.abc import Iterable

from dqreg.compare.trust import chance, clouds, drives, good, misfit, rivals, sheets, starts
from dqreg.compare.trust.task import Kind
from dqreg.errors import InputError, did_you_mean

_ROOMS = (good, clouds, drives, chance, misfit, rivals, sheets, starts)
KINDS: dict[str, Kind] = {kind.name: kind for room in _ROOMS for kind in room.KINDS}
GROUPS = tuple(dict.fromkeys(kind.group for kind in KINDS.values()))


def kinds_named(names: Iterable[str]) -> list[Kind]:
    """Kinds by their names or groups; all where none is named."""
    asked = list(names)
    for name in asked:
        if name not in KINDS and name not in GROUPS:
            hint = did_you_mean(name, [*KINDS, *GROUPS]) or f"; groups are {', '.join(GROUPS)}"
            raise InputError(f"--kinds {name} is not known{hint}")
    return [kind for kind in KINDS.values() if not asked or kind.name in asked or kind.group in asked]
