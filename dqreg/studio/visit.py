"""A visit of the studio: all that was chosen, as one small value; everything that is shown follows from it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.json_records import read_json
from dqreg.files.strict_json import plain, record_from
from dqreg.files.units import METRES
from dqreg.inspection.plan.file import HEAD
from dqreg.inspection.tolerances import share_of_percent

Vector = tuple[float, float, float]
Matrix = tuple[tuple[float, ...], ...]
Start = Literal["none", "identity", "pairs", "hand", "rival"]
Alignment = Literal["best-fit", "faces", "datums", "points", "plan"]
Goal = Literal["best-fit", "tolerance", "minimax"]

# Key and number of the format, in saved visits.
FORMAT, VERSION = "dqreg_studio", 1
# File of a visit that a run writes a line to at each stage and iteration; the server reads on in it.
PROGRESS = "progress.jsonl"
# Files of the initial pose and of the plan, beside it.
START, PLAN = "start.txt", "plan.toml"
# Largest numbers of each, so that a visit stays small.
MAX_CUTS, MAX_PAIRS = 100, 200
MAX_CORNERS, MAX_WORDS = 2_000, 400
# Larger ones have no square: they are no place, and every distance to them is infinite.
MAX_NUMBER = 1e150


@dataclasses.dataclass(frozen=True)
class Side:
    """A file: the scan or the part."""

    name: str  # What it is called
    path: str  # Where it lies: absolute, or in the folder of the visit
    units: str | None = None  # Named by the user; None leaves it to the file


@dataclasses.dataclass(frozen=True)
class Cut:
    """A piece of the scan that is left out, in the scan's own coordinates."""

    kind: Literal["box", "lasso", "plane"]
    keep: bool = False  # Whether what is outside is left out instead
    low: Vector = (0.0, 0.0, 0.0)  # Box: two opposite corners
    high: Vector = (0.0, 0.0, 0.0)
    right: Vector = (1.0, 0.0, 0.0)  # Lasso: axes of the view it was drawn in, and corners along them
    up: Vector = (0.0, 1.0, 0.0)
    polygon: tuple[tuple[float, float], ...] = ()
    normal: Vector = (0.0, 0.0, 1.0)  # Plane: points within ``half`` of normal . p = offset
    offset: float = 0.0
    half: float = 0.0


@dataclasses.dataclass(frozen=True)
class Pair:
    """The same place, pointed at on both."""

    scan: Vector
    part: Vector
    weight: float = 1.0


@dataclasses.dataclass(frozen=True)
class Reference:
    """A point of the part that is held along its normal (RPS)."""

    point: Vector
    normal: Vector


@dataclasses.dataclass(frozen=True)
class FaceTolerance:
    """Largest deviation allowed on one face of the part: on both sides, or outside it and, in ``minus``, inside."""

    face: int
    tolerance: float
    minus: float | None = None


@dataclasses.dataclass(frozen=True)
class PlaneCut:
    """A section: a plane that part and scan are cut by."""

    point: Vector
    normal: Vector


@dataclasses.dataclass(frozen=True)
class Visit:
    """What was chosen so far; every step adds to it, nothing in it is computed."""

    scan: Side | None = None
    part: Side | None = None
    mirrored: bool = False  # Whether the scan comes from a left-handed frame: its x is reversed before all else
    cuts: tuple[Cut, ...] = ()
    start: Start = "none"
    pairs: tuple[Pair, ...] = ()
    T_start: Matrix | None = None  # T_part_scan, of a start by hand or by a rival
    dof: str = ""  # Motions that are allowed from the start, as in `register`; "" allows all
    alignment: Alignment = "best-fit"
    chosen: tuple[int, ...] = ()  # Faces that the best fit is on, and what it makes least
    weights: tuple[float, ...] = ()  # Of these faces; those that are missing are 1
    goal: Goal = "best-fit"
    datums: tuple[int, ...] = ()  # Faces A, B, C
    references: tuple[Reference, ...] = ()
    reach: float | None = None  # Points farther off the part are of something else
    tolerance: float | None = None  # On both sides, or outside the part and, in ``minus``, inside it
    minus: float | None = None
    required: float = 95.0  # Percentage of the points that must be within it
    faces: tuple[FaceTolerance, ...] = ()
    sections: tuple[PlaneCut, ...] = ()
    labels: tuple[Vector, ...] = ()  # Places of the part whose deviation is written on the picture
    views: tuple[tuple[float, float], ...] = ()  # Yaw and pitch of the pictures of the report, degrees
    head: tuple[tuple[str, str], ...] = ()
    plan: str = ""  # TOML: what of a plan that was read has no field above, such as characteristics

    def __post_init__(self) -> None:
        for name, most in (
            ("cuts", MAX_CUTS),
            ("pairs", MAX_PAIRS),
            ("references", MAX_PAIRS),
            ("labels", 50),
            ("sections", 20),
            ("weights", len(self.chosen)),
            ("views", 8),
        ):
            if len(getattr(self, name)) > most:
                raise InputError(f"{name}: {most} at most; got {len(getattr(self, name))}")
        if any(len(cut.polygon) > MAX_CORNERS for cut in self.cuts):
            raise InputError(f"a lasso has {MAX_CORNERS} corners at most")
        _require_lengths(self)
        for side in (self.scan, self.part):
            if side is not None and side.units is not None and side.units not in METRES:
                raise InputError(f"unknown unit {side.units!r:.40}; known are {', '.join(METRES)}")
        if len(set(self.datums)) != len(self.datums) or len(self.datums) > 3:
            raise InputError("datums are up to three different faces")
        if self.T_start is not None and np.shape(self.T_start) != (4, 4):
            raise InputError("a pose is four rows of four numbers")
        for key, words in self.head:
            if key not in HEAD or len(words) > MAX_WORDS:
                raise InputError(f"the head has {', '.join(HEAD)}, {MAX_WORDS} letters each; got {key!r:.40}")

    def changed(self, values: dict[str, Any]) -> Visit:
        """The visit with some fields replaced by plain values, each checked; files are not changed this way."""
        known = {field.name for field in dataclasses.fields(self)} - {"scan", "part"}
        for name in values:
            if name not in known:
                raise InputError(f"a visit has no {name!r:.40} to be changed")
        found = Visit.of({**plain(self), **values})
        if found.mirrored == self.mirrored:
            return found
        # What was pointed at on the scan lies elsewhere on its mirror image.
        return dataclasses.replace(found, cuts=(), pairs=(), start="none", T_start=None)

    def with_units(self, which: Literal["scan", "part"], units: str | None) -> Visit:
        """The visit with the unit of a side named."""
        side = getattr(self, which)
        if side is None:
            raise InputError(f"there is no {which} yet")
        return dataclasses.replace(self, **{which: dataclasses.replace(side, units=units)})

    def swapped(self) -> Visit:
        """The two files exchanged, and nothing else kept: what was pointed at was on the other one."""
        return Visit(scan=self.part, part=self.scan, head=self.head)

    @staticmethod
    def of(values: Any) -> Visit:
        """A visit from plain values, as JSON has them."""
        found = record_from(Visit, {**_defaults(), **values} if isinstance(values, dict) else values)
        if not all(abs(x) < MAX_NUMBER for x in _numbers(found)):
            raise InputError(f"a visit holds finite numbers only, none of {MAX_NUMBER:g} or more")
        return found

    @staticmethod
    def load(path: str | Path) -> Visit:
        """Read a saved visit; its files are looked for beside it where their own paths lead nowhere."""
        place = Path(path)
        values = read_json(place, "a visit of dqreg studio", kind="saved visit")
        if values.pop(FORMAT, None) != VERSION:
            raise InputError(f'{place} is no saved visit: it has no "{FORMAT}": {VERSION}')
        found = Visit.of(values)
        return dataclasses.replace(found, scan=_beside(found.scan, place), part=_beside(found.part, place))

    def as_text(self) -> str:
        """The visit as `load` reads it."""
        return json.dumps({FORMAT: VERSION, **plain(self)}, indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the visit."""
        write_atomically(path, self.as_text())


def _defaults() -> dict[str, Any]:
    return dict(plain(Visit()))


def _beside(side: Side | None, saved: Path) -> Side | None:
    if side is None or (Path(side.path).is_absolute() and Path(side.path).is_file()):
        return side
    # A file that was dropped on the page lies in the folder of its visit.
    own = saved.parent / side.path
    return dataclasses.replace(side, path=str((own if own.is_file() else saved.parent / side.name).absolute()))


def _require_lengths(visit: Visit) -> None:
    if visit.reach is not None and not visit.reach > 0.0:
        raise InputError(f"reach must be a length above 0; got {visit.reach!r}")
    share_of_percent(visit.required, "required")
    _require_sides("tolerance", visit.tolerance, visit.minus)
    for row in visit.faces:
        _require_sides(f"the tolerance of face {row.face}", row.tolerance, row.minus)
        if row.face < 0:
            raise InputError(f"faces have numbers from 0; got {row.face}")
    if any(not np.linalg.norm(each.normal) > 0.0 for each in visit.sections):
        raise InputError("the normal of a section must not be of length zero")
    if any(not weight > 0.0 for weight in visit.weights):
        raise InputError("the weight of a face is a number above 0; leave the face out instead")
    if any(not pair.weight > 0.0 for pair in visit.pairs):
        raise InputError("the weight of a pair is a number above 0")


def _require_sides(name: str, plus: float | None, minus: float | None) -> None:
    if plus is None:
        if minus is not None:
            raise InputError(f"{name}: a lower side needs an upper one, as +0.1/-0.05")
    elif minus is None and not plus > 0.0:
        raise InputError(f"{name} must be a length above 0; got {plus!r}")
    elif minus is not None and not (plus >= 0.0 and minus >= 0.0 and plus + minus > 0.0):
        raise InputError(f"{name}: both sides are 0 or more, and one is above it; got +{plus:g}/-{minus:g}")


def _numbers(value: Any) -> list[float]:
    """All numbers of a record, however deep."""
    if isinstance(value, int | float):
        return [value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [x for field in dataclasses.fields(value) for x in _numbers(getattr(value, field.name))]
    return [x for item in value for x in _numbers(item)] if isinstance(value, tuple) else []
