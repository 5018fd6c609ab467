"""An inspection plan: datums, alignment and characteristics as one TOML file; every mistake names its entry."""

from __future__ import annotations

import dataclasses
import os
import tomllib
from pathlib import Path
from typing import Any, Literal, get_args

from dqreg.errors import InputError
from dqreg.files.units import METRES
from dqreg.inspection.plan_keys import (
    FaceName,
    face_of,
    faces_of_list,
    list_of,
    number_of,
    require_known,
    require_one_of,
    triple_of,
)
from dqreg.inspection.planned_alignment import PlannedStep, steps_of
from dqreg.inspection.planned_report import PlannedReport, planned_report
from dqreg.inspection.planned_tolerances import SIDES, FaceTolerance, face_tolerances, sides_of, whole_tolerance
from dqreg.inspection.tolerances import Tolerance

CharacteristicKind = Literal[
    "diameter",
    "distance",
    "angle",
    "form",
    "parallelism",
    "perpendicularity",
    "angularity",
    "position",
    "coaxiality",
    "profile",
    "thickness",
    "width",
    "length",
    "slot-position",
    "edge-point",
]
AlignmentKind = Literal["best-fit", "datums", "steps"]

KEYS = ("units", "head", "alignment", "datum", "characteristic", "section", "face", "report", *SIDES, "required")
# Faces that a characteristic is of; one of a distance or an angle is of two.
FACES: dict[str, int] = {"distance": 2, "angle": 2}
# Those of a slot: of all the faces of its wall.
OF_SLOT = ("width", "length", "slot-position")
# Those that relate a face to a datum.
TO_DATUM = ("parallelism", "perpendicularity", "angularity", "coaxiality")
# Zones: their tolerance is a width from 0, and nothing is nominal.
ZONES = ("form", *TO_DATUM, "position", "profile", "slot-position")


@dataclasses.dataclass(frozen=True)
class PlannedDatum:
    """A datum: its letter and its face."""

    name: str
    face: FaceName


@dataclasses.dataclass(frozen=True)
class PlannedCharacteristic:
    """One line of the drawing."""

    name: str
    kind: CharacteristicKind
    faces: tuple[FaceName, ...]
    datum: str = ""  # Of an orientation
    nominal: float | None = None  # Default: from the part
    plus: float = 0.0  # Largest value above nominal; of a zone its width
    minus: float = 0.0  # Largest value below nominal
    middle: float = 0.0  # Of the zone of a profile that is not equal to both sides: outside the part positive
    point: tuple[float, float, float] | None = None  # Near the edge of an edge point


@dataclasses.dataclass(frozen=True)
class PlannedSection:
    """A cut: its name, a point of the plane and its normal."""

    name: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is asked of a part.

    Attributes
    ----------
    head : dict of str
        Fields of the report's head as given: part, drawing, serial, operator, device, note.
    datums : tuple of PlannedDatum
        In their order of precedence.
    alignment : {"best-fit", "datums", "steps"}
        Which pose the characteristics are of.
    characteristics : tuple of PlannedCharacteristic
        In the order of the file.
    units : str or None
        Length unit of the plan and its part; None: the part's, whatever it is.
    steps : tuple of PlannedStep
        Alignments that follow each other, where ``alignment`` is "steps".
    sections : tuple of PlannedSection
        Cuts of part and scan.
    tolerance : Tolerance or None
        Of deviations anywhere on the part; None where none is given.
    face_tolerances : tuple of FaceTolerance
        Faces with a tolerance of their own, in the order of the file: the last that names a face counts.
    report : PlannedReport
        Which parts of the report are written.
    """

    head: dict[str, str]
    datums: tuple[PlannedDatum, ...]
    alignment: AlignmentKind
    characteristics: tuple[PlannedCharacteristic, ...]
    units: str | None = None
    steps: tuple[PlannedStep, ...] = ()
    sections: tuple[PlannedSection, ...] = ()
    tolerance: Tolerance | None = None
    face_tolerances: tuple[FaceTolerance, ...] = ()
    report: PlannedReport = PlannedReport()


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a plan.

    Parameters
    ----------
    path : str or path
        TOML with the tables ``head``, ``alignment``, ``datum``, ``characteristic``, ``section``, ``face`` and
        ``report``; see docs/howto_inspection.md.

    Returns
    -------
    Plan
        Checked as far as a plan can be without its part.

    Raises
    ------
    InputError
        If the file cannot be read, or an entry is wrong: the message names it.
    """
    try:
        values = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read the plan {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        # TOML's own errors are of values; numbers of too many digits and arrays in arrays in arrays have none.
        raise InputError(f"the plan {path} is no TOML: {error}") from error
    return plan_of(values, str(path))


def plan_of(values: dict[str, Any], name: str = "plan") -> Plan:
    """A plan from the values of a TOML file, each checked under the name of its entry."""
    require_known(values, KEYS, name)
    datums = tuple(_datum(entry, f"{name}: datum {k + 1}") for k, entry in enumerate(list_of(values, "datum", name)))
    letters = [datum.name for datum in datums]
    for letter in letters:
        if letters.count(letter) > 1:
            raise InputError(f"{name}: datum {letter} is given twice")
    rows = list_of(values, "characteristic", name)
    whole, single = whole_tolerance(values, name), face_tolerances(values, name)
    if not rows and whole is None and not single:
        raise InputError(f"{name}: no [[characteristic]] and no tolerance is given, so there is nothing to inspect")
    characteristics = tuple(
        _characteristic(entry, f"{name}: characteristic {k + 1}", letters) for k, entry in enumerate(rows)
    )
    chosen = values.get("alignment", "datums" if datums else "best-fit")
    steps = steps_of(chosen, letters, name) if isinstance(chosen, list) else ()
    alignment: AlignmentKind = "steps" if steps else chosen
    if not steps:
        require_one_of(chosen, ("best-fit", "datums"), f"{name}: alignment")
    if alignment == "datums" and not datums:
        raise InputError(f'{name}: alignment = "datums" needs [[datum]] entries')
    units = values.get("units")
    if units is not None:
        require_one_of(units, sorted(METRES), f"{name}: units")
    cuts = enumerate(list_of(values, "section", name))
    sections = tuple(_section(entry, f"{name}: section {k + 1}") for k, entry in cuts)
    head = values.get("head", {})
    if not isinstance(head, dict):
        raise InputError(f"{name}: head must be a table of words")
    words = {key: str(value) for key, value in head.items()}
    report = planned_report(values, tuple(cut.name for cut in sections), name)
    return Plan(words, datums, alignment, characteristics, units, steps, sections, whole, single, report)


def _datum(entry: Any, where: str) -> PlannedDatum:
    require_known(entry, ("name", "face", "near", "box"), where)
    letter = entry.get("name")
    if not isinstance(letter, str) or not letter:
        raise InputError(f'{where}: name must be a letter such as "A"; got {letter!r}')
    return PlannedDatum(letter, face_of(entry, where))


def _section(entry: Any, where: str) -> PlannedSection:
    require_known(entry, ("name", "point", "normal"), where)
    point, normal = (triple_of(entry, key, where) for key in ("point", "normal"))
    if not any(normal):
        raise InputError(f"{where}: normal must not be of length zero")
    return PlannedSection(str(entry.get("name", where.rpartition(": ")[2])), point, normal)


def _characteristic(entry: Any, where: str, letters: list[str]) -> PlannedCharacteristic:
    require_known(
        entry,
        ("name", "kind", "face", "faces", "near", "box", "point", "datum", "nominal", *SIDES),
        where,
    )
    kind = entry.get("kind")
    require_one_of(kind, get_args(CharacteristicKind), f"{where}: kind")
    where = f"{where} ({entry.get('name', kind)})"
    datum = entry.get("datum", "")
    if kind in TO_DATUM or datum:
        require_one_of(datum, letters, f"{where}: datum")
    plus, minus = sides_of(entry, where)
    nominal, middle = number_of(entry, "nominal", where) if "nominal" in entry else None, 0.0
    if kind == "profile" and "tolerance" not in entry:
        # Unilateral or unequal: the zone reaches from minus below the part's surface to plus above it.
        middle, plus, minus = 0.5 * (plus - minus), plus + minus, 0.0
    point = triple_of(entry, "point", where) if kind == "edge-point" or "point" in entry else None
    if point is not None and kind != "edge-point":
        raise InputError(f"{where}: point is of an edge-point; name the faces of a {kind} by face, near or box")
    return PlannedCharacteristic(
        str(entry.get("name", kind)), kind, _faces(entry, kind, where), datum, nominal, plus, minus, middle, point
    )


def _faces(entry: dict[str, Any], kind: str, where: str) -> tuple[FaceName, ...]:
    wanted, given = FACES.get(kind, 1), entry.get("faces")
    if kind in OF_SLOT and given is not None:
        found = faces_of_list(given, where)
        if not found:
            raise InputError(f"{where}: faces are all faces of the slot's wall; none is given")
        return found
    if wanted == 1 and given is not None:
        raise InputError(f"{where}: a {kind} is of one face: face = 3; got faces = {given!r:.60}")
    if kind == "edge-point" and not {"face", "near", "box"} & set(entry):
        # The larger of the two that meet there.
        return ()
    if wanted == 1:
        return (face_of(entry, where),)
    if not isinstance(given, list) or len(given) != wanted or {"face", "near", "box"} & set(entry):
        raise InputError(f"{where}: a {kind} is of two faces: faces = [3, 4]; got {given!r:.60}")
    return faces_of_list(given, where)
