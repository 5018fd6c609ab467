"""Steps of an alignment in a plan: what is laid on what, with which weights, bands and locked motions."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

from dqreg.errors import InputError
from dqreg.inspection.plan_keys import FaceName, faces_of_list, number_of, require_known, require_one_of
from dqreg.inspection.planned_tolerances import SIDES, sides_of
from dqreg.solvers.dof import Freedom

StepKind = Literal["best-fit", "tolerance", "minimax", "outside", "inside", "datums", "points"]
KEYS = ("name", "kind", "faces", "weights", *SIDES, "dof", "points")


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
    band = None
    if any(key in entry for key in SIDES):
        plus, minus = sides_of(entry, where)
        band = (-minus, plus)
    if kind == "tolerance" and band is None:
        raise InputError(f"{where}: a tolerance fit needs tolerance, or plus and minus")
    faces = faces_of_list(entry.get("faces", []), where)
    if faces and kind in ("datums", "points"):
        raise InputError(f"{where}: faces do not go with kind = {kind!r}")
    return PlannedStep(
        name=str(entry.get("name", kind)),
        kind=kind,
        faces=faces,
        weights=_weights(entry.get("weights", []), len(faces), where),
        band=band,
        dof=_dof(entry.get("dof", "all"), where),
        points=_points(entry.get("points", []), kind, where),
    )


def _weights(given: Any, count: int, where: str) -> tuple[float, ...]:
    if not isinstance(given, list) or len(given) not in (0, count):
        raise InputError(f"{where}: weights is a list of as many numbers as faces; got {given!r:.60}")
    weights = tuple(number_of({"weights": each}, "weights", where) for each in given)
    if any(weight <= 0.0 for weight in weights):
        raise InputError(f"{where}: weights are above 0; leave a face out instead; got {given!r:.60}")
    return weights


def _dof(given: Any, where: str) -> str:
    if not isinstance(given, str):
        raise InputError(f'{where}: dof is text such as "tz rx ry"; got {given!r:.60}')
    try:
        Freedom.parse(given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return given


def _points(given: Any, kind: str, where: str) -> tuple[tuple[float, ...], ...]:
    if (kind == "points") != bool(given) or not isinstance(given, list):
        raise InputError(f'{where}: points = [[x, y, z], ...] goes with kind = "points", and only with it')
    for each in given:
        if not isinstance(each, list) or len(each) not in (3, 6):
            raise InputError(
                f"{where}: a point is [x, y, z], or [x, y, z, dx, dy, dz] with its direction; got {each!r:.60}"
            )
        if len(each) == 6 and not any(each[3:]):
            raise InputError(f"{where}: the direction of a point must not be of length zero; got {each!r:.60}")
    return tuple(tuple(number_of({"points": x}, "points", where) for x in each) for each in given)
