"""Steps of an alignment in a plan: what is laid on what, with which weights, bands and locked motions."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

from dqreg.errors import InputError
from dqreg.inspection.plan_keys import FaceName, faces_of_list, number_of, require_known, require_one_of

StepKind = Literal["best-fit", "tolerance", "minimax", "outside", "inside", "datums", "points"]
KEYS = ("name", "kind", "faces", "weights", "tolerance", "plus", "minus", "dof", "points")


@dataclasses.dataclass(frozen=True)
class PlannedStep:
    """One step of an alignment."""

    name: str
    kind: StepKind
    faces: tuple[FaceName, ...] = ()  # Those that count; none: all
    weights: tuple[float, ...] = ()  # Of each of them; none: 1
    band: tuple[float, float] | None = None  # Signed deviations allowed, outside the part positive
    dof: str = "all"  # Degrees of freedom away from the step before
    # Reference points: place on the part and, where given, the direction that it counts along
    points: tuple[tuple[float, ...], ...] = ()


def steps_of(entries: list[Any], letters: list[str], name: str) -> tuple[PlannedStep, ...]:
    """The steps of `[[alignment]]`, in their order."""
    return tuple(_step(entry, letters, f"{name}: alignment {k + 1}") for k, entry in enumerate(entries))


def _step(entry: Any, letters: list[str], where: str) -> PlannedStep:
    require_known(entry, KEYS, where)
    kind = entry.get("kind")
    require_one_of(kind, get_args(StepKind), f"{where}: kind")
    if kind == "datums" and not letters:
        raise InputError(f'{where}: kind = "datums" needs [[datum]] entries')
    faces = entry.get("faces", [])
    weights = entry.get("weights", [])
    if not isinstance(faces, list) or not isinstance(weights, list) or len(weights) not in (0, len(faces)):
        raise InputError(f"{where}: faces is a list such as [3, 4], weights one of as many numbers")
    band = None
    if "tolerance" in entry:
        band = (-number_of(entry, "tolerance", where), number_of(entry, "tolerance", where))
    elif "plus" in entry or "minus" in entry:
        plus, minus = (number_of(entry, key, where) if key in entry else 0.0 for key in ("plus", "minus"))
        band = (-minus, plus)
    if band is not None and not band[0] < band[1]:
        raise InputError(f"{where}: a band is above 0 wide; got plus {band[1]:g}, minus {-band[0]:g}")
    if kind == "tolerance" and band is None:
        raise InputError(f"{where}: a tolerance fit needs tolerance, or plus and minus")
    dof = entry.get("dof", "all")
    if not isinstance(dof, str):
        raise InputError(f'{where}: dof is text such as "tz rx ry"; got {dof!r}')
    return PlannedStep(
        name=str(entry.get("name", kind)),
        kind=kind,
        faces=faces_of_list(faces, where),
        weights=tuple(number_of({"weights": each}, "weights", where) for each in weights),
        band=band,
        dof=dof,
        points=_points(entry.get("points", []), kind, where),
    )


def _points(given: Any, kind: str, where: str) -> tuple[tuple[float, ...], ...]:
    if (kind == "points") != bool(given) or not isinstance(given, list):
        raise InputError(f'{where}: points = [[x, y, z], ...] goes with kind = "points", and only with it')
    for each in given:
        if not isinstance(each, list) or len(each) not in (3, 6):
            raise InputError(
                f"{where}: a point is [x, y, z], or [x, y, z, dx, dy, dz] with its direction; got {each!r}"
            )
    return tuple(tuple(number_of({"points": x}, "points", where) for x in each) for each in given)
