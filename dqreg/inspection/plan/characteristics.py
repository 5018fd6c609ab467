"""A characteristic of a plan: its kind, what it is of, its nominal value and its tolerance."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

from dqreg.errors import InputError
from dqreg.inspection.drawing.zone_features import METHODS, PlannedFit
from dqreg.inspection.plan.keys import (
    FaceName,
    face_of,
    faces_of_list,
    number_of,
    require_known,
    require_one_of,
    triple_of,
)
from dqreg.inspection.plan.tolerances import SIDES, sides_of

CharacteristicKind = Literal[
    "diameter",
    "distance",
    "angle",
    "form",
    "roundness",
    "straightness",
    "parallelism",
    "perpendicularity",
    "angularity",
    "position",
    "coaxiality",
    "circular-runout",
    "total-runout",
    "profile",
    "line-profile",
    "thickness",
    "width",
    "length",
    "slot-position",
    "edge-point",
]
# Words of drawings for what has another name here.
SYNONYMS = {
    **dict.fromkeys(("flatness", "cylindricity", "sphericity"), "form"),
    "circularity": "roundness",
    "concentricity": "coaxiality",
    "squareness": "perpendicularity",
    "circular runout": "circular-runout",
    "total runout": "total-runout",
    **dict.fromkeys(("surface profile", "profile of a surface"), "profile"),
    **dict.fromkeys(("line profile", "profile of a line", "profile of any line"), "line-profile"),
}
# Words of drawings for what is not measured under any name, and what is instead.
NOT_MEASURED = {
    "radius": "a radius is measured as a diameter, with limits twice as wide",
    **dict.fromkeys(("depth", "height"), 'it is the distance of two faces: kind = "distance"'),
    "runout": "it is circular-runout, of sections, or total-runout, of the whole face",
    "symmetry": "symmetry is not measured; the position of a hole and the slot-position of a slot are",
}
# Faces that a characteristic is of; one of a distance or an angle is of two.
FACES: dict[str, int] = {"distance": 2, "angle": 2}
# Those of a slot: of all the faces of its wall.
OF_SLOT = ("width", "length", "slot-position")
# Those that relate a face to a datum.
RUNOUT = ("circular-runout", "total-runout")
TO_DATUM = ("parallelism", "perpendicularity", "angularity", "coaxiality", *RUNOUT)
# Those that depend on how the part is aligned.
UNDER = ("position", "slot-position", "profile", "line-profile", "edge-point")
# Zones: their tolerance is a width from 0, and nothing is nominal.
PROFILES = ("profile", "line-profile")
ZONES = ("form", "roundness", "straightness", *TO_DATUM, "position", *PROFILES, "slot-position")
# Those of fitted features.
FITTED = ("diameter", "distance", "angle", "parallelism", "perpendicularity", "angularity", "coaxiality", "position")
# Which lines of a face a characteristic is of: key by key the kinds that it goes with.
LINE_KEYS = {
    "at": ("roundness", "straightness", "circular-runout"),
    **dict.fromkeys(("direction", "of"), ("roundness", "straightness")),
    "section": ("line-profile",),
}
# What a straightness may be of; a roundness is of the first.
OF = ("surface", "axis")
Triple = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class PlannedLine:
    """Lines of a face."""

    at: tuple[Triple, ...] = ()  # Places that they go through; none: spread over the face
    direction: Triple | None = None  # Of the lines of a flat face; normal of the section of a sphere
    of_axis: bool = False  # The axis in place of the surface
    section: str = ""  # Name of the cut whose outline it is


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
    line: PlannedLine = PlannedLine()  # Which lines of the face a roundness or straightness is of
    fit: PlannedFit = "gauss"  # Of its features

    @property
    def largest_deviation(self) -> float:
        """Largest deviation of a face that it allows, a length; 0 for an angle."""
        if self.kind in ZONES:
            return 0.5 * self.plus + abs(self.middle)
        return 0.0 if self.kind == "angle" else max(self.plus, self.minus)


def characteristic_of(entry: Any, where: str, letters: list[str], cuts: list[str]) -> PlannedCharacteristic:
    """The characteristic of an entry, given the letters of the datums and the names of the sections."""
    require_known(
        entry,
        ("name", "kind", "face", "faces", "near", "box", "point", "datum", "nominal", *SIDES, *LINE_KEYS, "fit"),
        where,
    )
    kind = entry.get("kind")
    _require_kind(kind, f"{where}: kind")
    where = f"{where} ({entry.get('name', kind)})"
    plus, minus = sides_of(entry, where)
    nominal, middle = _nominal(entry, kind, where), 0.0
    if kind in PROFILES and "tolerance" not in entry:
        # Unilateral or unequal: the zone reaches from minus below the part's surface to plus above it.
        middle, plus, minus = 0.5 * (plus - minus), plus + minus, 0.0
    point = triple_of(entry, "point", where) if kind == "edge-point" or "point" in entry else None
    if point is not None and kind != "edge-point":
        raise InputError(f"{where}: point is of an edge-point; name the faces of a {kind} by face, near or box")
    if "fit" in entry and kind not in FITTED:
        raise InputError(f"{where}: fit goes with {', '.join(FITTED)}; a {kind} is of the surface itself")
    return PlannedCharacteristic(
        str(entry.get("name", kind)),
        kind,
        _faces(entry, kind, where),
        _datum(entry, kind, where, letters),
        nominal,
        plus,
        minus,
        middle,
        point,
        _line(entry, kind, where, cuts),
        fit_of(entry, where),
    )


def _require_kind(kind: Any, where: str) -> None:
    """Raise where a kind is none of those known; words of drawings are told what they are here."""
    word = kind.strip().lower().replace("_", " ") if isinstance(kind, str) else ""
    if word in SYNONYMS:
        raise InputError(f'{where} is called by another name here: write kind = "{SYNONYMS[word]}"; got {kind!r}')
    if word in NOT_MEASURED:
        raise InputError(f"{where}: got {kind!r}; {NOT_MEASURED[word]}")
    require_one_of(kind, get_args(CharacteristicKind), where)


def _nominal(entry: dict[str, Any], kind: str, where: str) -> float | None:
    nominal = number_of(entry, "nominal", where) if "nominal" in entry else None
    if nominal is not None and kind == "angle" and not 0.0 <= nominal <= 180.0:
        raise InputError(f"{where}: nominal of an angle is 0 to 180 degrees; got {nominal:g}: give it in that range")
    return nominal


def _datum(entry: dict[str, Any], kind: str, where: str, letters: list[str]) -> str:
    """The letter of the datum that a characteristic is to; one that would not be heeded is refused."""
    datum = entry.get("datum", "")
    if datum and kind not in TO_DATUM:
        under = 'is under the alignment of the plan: alignment = "datums" lays it on all [[datum]] entries'
        raise InputError(
            f"{where}: datum goes with {', '.join(TO_DATUM)}; a {kind} {under if kind in UNDER else 'has none'}; "
            f"got {datum!r:.60}: leave it out"
        )
    if kind in TO_DATUM:
        require_one_of(datum, letters, f"{where}: datum")
    return str(datum)


def _faces(entry: dict[str, Any], kind: str, where: str) -> tuple[FaceName, ...]:
    wanted, given = FACES.get(kind, 1), entry.get("faces")
    if kind == "line-profile" and not {"face", "near", "box"} & set(entry):
        # All that the section cuts, unless some are named.
        return () if given is None else faces_of_list(given, where)
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


def fit_of(entry: dict[str, Any], where: str) -> PlannedFit:
    """How the feature of an entry is fitted."""
    fit: PlannedFit = entry.get("fit", "gauss")
    require_one_of(fit, tuple(METHODS), f"{where}: fit")
    return fit


def _line(entry: dict[str, Any], kind: str, where: str, cuts: list[str]) -> PlannedLine:
    given = [key for key in LINE_KEYS if key in entry]
    for key in given:
        if kind not in LINE_KEYS[key]:
            raise InputError(f"{where}: {key} goes with {', '.join(LINE_KEYS[key])}, not with {kind}")
    of = entry.get("of", "surface")
    require_one_of(of, OF if kind == "straightness" else OF[:1], f"{where}: of")
    if of == "axis" and len(given) > 1:
        raise InputError(f'{where}: {given[0]} does not go with of = "axis", which is measured as a whole')
    direction = triple_of(entry, "direction", where) if "direction" in entry else None
    if direction is not None and not any(direction):
        raise InputError(f"{where}: direction must not be of length zero")
    section = entry.get("section", "")
    if kind == "line-profile":
        require_one_of(section, cuts, f"{where}: section, the name of a [[section]],")
    return PlannedLine(_places(entry, where), direction, of == "axis", section)


def _places(entry: dict[str, Any], where: str) -> tuple[Triple, ...]:
    given = entry.get("at")
    if given is None:
        return ()
    if isinstance(given, list) and given and all(isinstance(each, list) for each in given):
        return tuple(triple_of({"at": each}, "at", where) for each in given)
    return (triple_of(entry, "at", where),)
