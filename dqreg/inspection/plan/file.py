"""An inspection plan: datums, alignment and characteristics as one TOML file; every mistake names its entry."""

from __future__ import annotations

import dataclasses
import os
import tomllib
from pathlib import Path
from typing import Any, Literal

from dqreg.errors import InputError
from dqreg.files.units import METRES
from dqreg.inspection.drawing.zone_features import PlannedFit
from dqreg.inspection.plan.alignment import PlannedStep, steps_of
from dqreg.inspection.plan.characteristics import PlannedCharacteristic, characteristic_of, fit_of
from dqreg.inspection.plan.keys import (
    FaceName,
    face_of,
    list_of,
    number_of,
    require_known,
    require_one_of,
    triple_of,
)
from dqreg.inspection.plan.report import PlannedReport, planned_report
from dqreg.inspection.plan.tolerances import SIDES, FaceTolerance, face_tolerances, whole_tolerance
from dqreg.inspection.tolerances import Tolerance

AlignmentKind = Literal["best-fit", "datums", "steps"]

# Fields of the report's head that batches and the studio ask for; a plan may have others.
HEAD = ("part", "drawing", "serial", "order", "operator", "device", "note")
TABLES = ("head", "alignment", "datum", "characteristic", "section", "face", "report")
FIRST_PLAN = "dqreg inspect --suggest PART > plan.toml writes a first one"
KEYS = ("units", *TABLES, *SIDES, "required", "expected_deviation")


@dataclasses.dataclass(frozen=True)
class PlannedDatum:
    """A datum: its letter and its face."""

    name: str
    face: FaceName
    fit: PlannedFit = "gauss"


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
        Fields of the report's head as given: part, drawing, serial, order, operator, device, note.
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
    expected_deviation : float or None
        Of the part from its model, for the registration, see `dqreg.register`; None: by the tolerances.
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
    expected_deviation: float | None = None

    @property
    def largest_deviation(self) -> float:
        """Largest deviation of a face that a tolerance of the plan allows; 0 where there is none."""
        wholes = [self.tolerance, *(own.tolerance for own in self.face_tolerances)]
        of_faces = [each.size for each in wholes if each is not None]
        return max([*of_faces, *(row.largest_deviation for row in self.characteristics)], default=0.0)


def read_plan(path: str | os.PathLike[str]) -> Plan:
    r"""Read a plan.

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

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "plan.toml").write_text('units = "mm"\ntolerance = 0.15\n[[face]]\nface = 2\nplus = 0.3\n')
    ...     plan = read_plan(f"{folder}/plan.toml")
    >>> plan.units, plan.tolerance.high, plan.face_tolerances[0].tolerance.high
    ('mm', 0.15, 0.3)
    """
    try:
        values = tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read the plan {path}: {error.strerror or error}; {FIRST_PLAN}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"the plan {path} is no TOML: it holds bytes that are no UTF-8 text; {FIRST_PLAN}") from error
    except (ValueError, RecursionError) as error:
        # TOML's own errors are of values; numbers of too many digits and arrays in arrays in arrays have none.
        raise InputError(f"the plan {path} is no TOML: {error}; {FIRST_PLAN}") from error
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
    cuts = enumerate(list_of(values, "section", name))
    sections = tuple(_section(entry, f"{name}: section {k + 1}") for k, entry in cuts)
    names = [cut.name for cut in sections]
    characteristics = tuple(
        characteristic_of(entry, f"{name}: characteristic {k + 1}", letters, names) for k, entry in enumerate(rows)
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
    head = values.get("head", {})
    if not isinstance(head, dict):
        raise InputError(f"{name}: head must be a table of words")
    words = {key: str(value) for key, value in head.items()}
    report = planned_report(values, tuple(names), name)
    expected = number_of(values, "expected_deviation", name) if "expected_deviation" in values else None
    if expected is not None and not expected > 0.0:
        raise InputError(f"{name}: expected_deviation is a length above 0; got {expected:g}")
    return Plan(words, datums, alignment, characteristics, units, steps, sections, whole, single, report, expected)


def _datum(entry: Any, where: str) -> PlannedDatum:
    require_known(entry, ("name", "face", "near", "box", "fit"), where)
    letter = entry.get("name")
    if not isinstance(letter, str) or not letter:
        raise InputError(f'{where}: name must be a letter such as "A"; got {letter!r}')
    return PlannedDatum(letter, face_of(entry, where), fit_of(entry, where))


def _section(entry: Any, where: str) -> PlannedSection:
    require_known(entry, ("name", "point", "normal"), where)
    point, normal = (triple_of(entry, key, where) for key in ("point", "normal"))
    if not any(normal):
        raise InputError(f"{where}: normal must not be of length zero")
    return PlannedSection(str(entry.get("name", where.rpartition(": ")[2])), point, normal)
