"""What a page of an inspection holds: head, characteristics and their labels, coverage, digests."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.side_digests import known_digests
from dqreg.inspection import Inspection, Place
from dqreg.inspection.decision.decision import worst_of
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.scanned_part.sections import Section
from dqreg.report.alignment_table import alignment_of
from dqreg.report.decision_rows import OUTCOME_SIGNS, shown_outcome
from dqreg.report.definitions import definitions_of
from dqreg.report.inspection_table import frame_words, kind_words, scale_words
from dqreg.report.section_picture import section_picture
from dqreg.report.text import measured_text, percent, text_of, unit_words

# Fields of the head that have words of their own, in their order; others follow as they are named.
FIELDS = {
    "part": "Part no.",
    "name": "Part name",
    "drawing": "Drawing",
    "serial": "Serial no.",
    "order": "Order",
    "operator": "Operator",
    "device": "Measuring device",
    "date": "Measured",
    "note": "Note",
}
COLUMNS = [("No.", "", False), ("Characteristic", "", False), ("Kind", "", False), ("Nominal", "", True),
           ("Low", "", True), ("High", "", True), ("Measured", "", True), ("U", "k = 2", True),
           ("Scanned", "%", True), ("Decision", "", False)]  # fmt: skip
# Faces below that share are called partly scanned.
WHOLE_SHARE = 0.9
# Faces that are listed; small ones that no characteristic names are summed up.
MAX_LISTED_FACES = 40


def head_rows(head: Mapping[str, str]) -> list[tuple[str, str]]:
    """Fields of the head that have a value: name and value.

    >>> head_rows({"serial": "7", "lot": "A", "operator": ""})
    [('Serial no.', '7'), ('Lot', 'A')]
    """
    order = [*(key for key in FIELDS if key in head), *(key for key in head if key not in FIELDS)]
    names = {key: FIELDS.get(key, key[:1].upper() + key[1:]) for key in order}
    return [(names[key], head[key]) for key in order if head[key]]


def sheet_of(found: Inspection | None, unit: str, *, trusted: bool) -> dict[str, Any] | None:
    """The sheet for the page's template."""
    if found is None:
        return None
    count = sum(row.outcome == "pass" for row in found.characteristics)
    missing = sum(not row.measured for row in found.characteristics)
    words = [f"Aligned to {frame_words(found)}."]
    if found.characteristics:
        words.append(f"{count} of {len(found.characteristics)} characteristics pass.")
    if found.decision is not None:
        said = shown_outcome(found.decision.outcome, trusted=trusted)["said"]
        words.append(f"The deviations against their tolerance: {said}.")
    words += scale_words(found)
    if missing:
        words.append(f"{missing} could not be measured, for the reasons named below.")
    return {
        **shown_outcome(found.outcome, trusted=trusted),
        "words": words,
        "columns": COLUMNS,
        "rows": _rows(found),
        "definitions": definitions_of(found),
        "remarks": [(k + 1, row.name, row.remark) for k, row in enumerate(found.characteristics) if row.remark],
        "unit": unit or "the unit of the part, which its file does not name",
        "coverage": _coverage(found, unit),
        "alignment": alignment_of(found, unit),
        "sections": _sections(found, unit),
    }


def _rows(found: Inspection) -> list[dict[str, Any]]:
    return [
        {
            "cells": [str(k + 1), row.name, kind_words(row)],
            "numbers": [
                *(text_of(x, 6) for x in (row.nominal, row.low, row.high)),
                *(measured_text(row.value, row.uncertainty) if row.measured else ("not measured", "–")),
                percent(row.coverage),
            ],
            "outcome": row.outcome,
            "sign": OUTCOME_SIGNS[row.outcome],
        }
        for k, row in enumerate(found.characteristics)
    ]


def _sections(found: Inspection, unit: str) -> list[dict[str, str]]:
    tolerance = None if found.decision is None else found.decision.tolerance
    signed = found.deviations is None or found.deviations.signed
    return [
        {
            "name": name,
            "picture": section_picture(cut, unit, tolerance, signed=signed),
            "words": section_words(cut, unit),
        }
        for name, cut in found.sections
        if found.plan.report.draws(name)
    ]


def section_words(cut: Section, unit: str) -> str:
    """Where a section is, and the deviations along it."""
    point, normal = (" ".join(f"{x + 0.0:.6g}" for x in each) for each in (cut.point, cut.normal))
    words = f"Plane through ({point}) with the normal ({normal})."
    known = cut.values[np.isfinite(cut.values)]
    if not len(known):
        return f"{words} Nothing of its outline was scanned."
    behind = unit_words(unit)
    ends = f"{text_of(float(known.min()), sign=True)} to {text_of(float(known.max()), sign=True)}{behind}"
    spread = text_of(COVERAGE_FACTOR * float(np.nanmax(cut.sigma)), 2)
    return f"{words} Deviations along it: {ends}, medians of the scan points there, U (k = 2) {spread}{behind} at most."


def _coverage(found: Inspection, unit: str) -> dict[str, Any] | None:
    """How much of each face was scanned: those of the plan first, then the largest."""
    if not found.faces:
        return None
    area = math.fsum(face.area for face in found.faces)
    seen = math.fsum(face.area * face.share for face in found.faces)
    ordered = sorted(found.faces, key=lambda face: (not face.used, -face.area))
    shown, rest = ordered[:MAX_LISTED_FACES], ordered[MAX_LISTED_FACES:]
    unseen = [face for face in found.faces if face.share == 0.0]
    words = [f"{percent(seen / max(area, 1e-300))} % of the part's surface was scanned."]
    if unseen:
        words.append(f"{len(unseen)} of its {len(found.faces)} faces were not scanned at all.")
    if rest:
        words.append(f"{len(rest)} smaller faces, which the plan does not name, are not listed.")
    return {
        "words": " ".join(words),
        "columns": [("Face", "", True), ("Shape", "", False), ("Area", f"{unit}²" if unit else "", True),
                    ("Points", "", True), ("Scanned", "%", True), ("", "", False)],
        "rows": [
            {
                "cells": [str(face.face)],
                "kind": face.kind,
                "numbers": [text_of(face.area, 4), f"{face.points:,}", percent(face.share)],
                "words": "whole" if face.share >= WHOLE_SHARE else "partly" if face.share > 0.0 else "not scanned",
                "used": face.used,
            }
            for face in shown
        ],
    }  # fmt: skip


def digests_of(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """SHA-256 of the files that were registered: name of the file and digest."""
    return [(Path(str(settings.get(side))).name, digest) for side, digest in known_digests(settings).items()]


@dataclasses.dataclass(frozen=True, eq=False)
class Label:
    """A number at a point of the part."""

    text: str
    position: FloatArray  # (3,): In the target's frame
    title: str  # What it marks
    kind: str  # "worst", or the outcome of what it marks


def labels_of(inspection: Inspection | None, worst: Sequence[Place], unit: str) -> tuple[Label, ...]:
    """Labels of the characteristics, one for all of the same face, or of the worst places where none is asked."""
    if inspection is None or not inspection.characteristics:
        return tuple(
            Label(str(k + 1), place.position, f"worst place {k + 1}: {text_of(place.value)}{unit_words(unit)}", "worst")
            for k, place in enumerate(worst)
        )
    rows: dict[tuple[float, float, float], list[int]] = {}
    for number, row in enumerate(inspection.characteristics):
        # One that is not of this part is nowhere on it.
        if not math.isnan(row.position[0]):
            rows.setdefault(row.position, []).append(number)
    found = []
    for position, numbers in rows.items():
        own = [inspection.characteristics[k] for k in numbers]
        title = "; ".join(f"{k + 1} {row.name}: {row.outcome}" for k, row in zip(numbers, own, strict=True))
        kind = worst_of([row.outcome for row in own])
        found.append(Label(ranges([k + 1 for k in numbers]), np.array(position), title, kind))
    return tuple(found)


def ranges(numbers: Sequence[int]) -> str:
    """Numbers in few letters.

    >>> ranges([1, 2, 3, 7, 9, 10])
    '1–3, 7, 9, 10'
    """
    words = []
    for _, group in itertools.groupby(enumerate(numbers), lambda pair: pair[1] - pair[0]):
        run = [number for _, number in group]
        words += [f"{run[0]}–{run[-1]}"] if len(run) > 2 else [str(number) for number in run]
    return ", ".join(words)
