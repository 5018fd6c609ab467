"""Tolerances of deviations in a plan: one for the whole part, and those of single faces."""

from __future__ import annotations

import dataclasses
from typing import Any

from dqreg.errors import InputError
from dqreg.inspection.plan.keys import FaceName, face_of, faces_of_list, list_of, number_of, require_known
from dqreg.inspection.tolerances import Tolerance, share_of_percent

SIDES = ("tolerance", "plus", "minus")


@dataclasses.dataclass(frozen=True)
class FaceTolerance:
    """Faces of a plan with a tolerance of their own."""

    faces: tuple[FaceName, ...]
    tolerance: Tolerance
    where: str = "face"  # Its entry, for words


def sides_of(entry: dict[str, Any], where: str) -> tuple[float, float]:
    """What is allowed above and below, both 0 or more: `tolerance`, or `plus` and `minus`, one of which may be left."""
    if "tolerance" in entry and ("plus" in entry or "minus" in entry):
        raise InputError(f"{where}: give tolerance, or plus and minus, not both")
    if "tolerance" in entry:
        plus = minus = number_of(entry, "tolerance", where)
    elif "plus" in entry or "minus" in entry:
        plus, minus = (number_of(entry, key, where) if key in entry else 0.0 for key in ("plus", "minus"))
    else:
        raise InputError(f"{where}: no tolerance is given; give tolerance, or plus and minus")
    if plus < 0.0 or minus < 0.0 or plus + minus <= 0.0:
        raise InputError(f"{where}: a tolerance is above 0; got plus {plus:g}, minus {minus:g}")
    return plus, minus


def whole_tolerance(values: dict[str, Any], name: str) -> Tolerance | None:
    """The tolerance of all faces that have none of their own."""
    if not any(key in values for key in SIDES):
        if "required" in values:
            raise InputError(f"{name}: required is a share of the points within a tolerance, and none is given")
        return None
    plus, minus = sides_of(values, name)
    return Tolerance(-minus, plus, _required(values, name))


def face_tolerances(values: dict[str, Any], name: str) -> tuple[FaceTolerance, ...]:
    """The `[[face]]` entries."""
    found = []
    for k, entry in enumerate(list_of(values, "face", name)):
        where = f"{name}: face entry {k + 1}"
        require_known(entry, ("face", "near", "box", "faces", *SIDES, "required"), where)
        faces = faces_of_list(entry["faces"], where) if "faces" in entry else (face_of(entry, where),)
        plus, minus = sides_of(entry, where)
        found.append(FaceTolerance(faces, Tolerance(-minus, plus, _required(entry, where)), where))
    return tuple(found)


def _required(entry: dict[str, Any], where: str) -> float | None:
    if "required" not in entry:
        return None
    return share_of_percent(number_of(entry, "required", where), f"{where}: required")
