"""The fourth and fifth step: deviations with their colours, the decision on the part, the report and the plan."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg.inspection import Deviations
from dqreg.inspection.decision.decision import decision_record
from dqreg.inspection.decision.regions import cut_of, regions_of
from dqreg.report.colours import Scale, nice_above
from dqreg.report.page import to_html
from dqreg.report.page_file import write_page
from dqreg.report.report_data import collect
from dqreg.report.section_picture import section_picture
from dqreg.report.sheet import Label
from dqreg.studio.aligning import RESULT
from dqreg.studio.alignments import deviations_of, judged, measured_at
from dqreg.studio.drawing import drawn_pose, frame_of
from dqreg.studio.equivalent_commands import cleaned_name
from dqreg.studio.payloads import cloud_payload, rows_to_draw
from dqreg.studio.plans import is_judged
from dqreg.studio.visit import PLAN, START
from dqreg.studio.worker_cache import Place

# Worst places that are listed, and the share of the points that the colours reach where no tolerance is given.
WORST_PLACES, COLOUR_QUANTILE = 8, 0.98
REPORT, PDF, REACH = "report.html", "report.pdf", "reach.bin"


def judge(place: Place) -> dict[str, Any]:
    """The part as it was measured: figures, decision, faces, places, sections, and the points in their colours."""
    inspected = judged(place)
    found, decision = inspected.deviations, inspected.decision
    limit = None if decision is None else decision.tolerance
    unit = found.units or ""
    answer: dict[str, Any] = {
        "summary": dataclasses.asdict(found.summary()),
        "counts": dataclasses.asdict(found.counts),
        "signed": found.signed,
        "sides": found.reason,
        "unit": found.units,
        "reach": found.reach,
        "drawing": _drawing(place, found, limit),
        "outcome": inspected.outcome if is_judged(place.visit) else None,
        "alignment_trusted": inspected.registration.verdict.level == "accepted",
        "characteristics": [
            dataclasses.asdict(row) for row in (inspected.sheet.characteristics if inspected.sheet else ())
        ],
        "labels": _labels(place, found),
        "sections": [
            {"name": name, "coverage": cut.coverage, "picture": section_picture(cut, unit, limit, signed=found.signed)}
            for name, cut in (inspected.sheet.sections if inspected.sheet else ())
        ],
        "worst": [
            {"value": each.value, "at": each.position.tolist(), "points": each.points}
            for each in found.worst(WORST_PLACES)
        ],
    }
    if decision is None:
        regions = [dataclasses.asdict(region) for region in regions_of(found, cut_of(found))]
        answer["faces"] = [region | {"centre": region["centre"] + found.origin} for region in regions]
    else:
        # Centres in the part's frame, as places are.
        answer["decision"] = decision_record(decision, found.origin)
        answer["faces"] = answer["decision"].pop("regions")
        answer["bands"] = [dataclasses.asdict(band) for band in found.bands(decision.tolerance).rows]
    return answer


def show_reach(place: Place) -> dict[str, Any]:
    """Which points belong to the part, in a colour for each kind, and the length that decides it."""
    found, frame = deviations_of(place), frame_of(place.part())
    rows = rows_to_draw(found.points - found.origin, np.ones(len(found), dtype=bool))
    words, data = cloud_payload(found.points, frame, rows)
    place.write(REACH, data + (1 + found.flags[rows[0]]).astype("<u1").tobytes())
    drawing = words | {"file": REACH, "kinds": True}
    share = found.reach / found.size if found.size > 0.0 else None
    return {
        "reach": found.reach,
        "from": found.reach_from,
        "share": share,
        "counts": dataclasses.asdict(found.counts),
        "drawing": drawing,
    }


def write_sheet(place: Place) -> dict[str, Any]:
    """Write the report, and the plan where there is one."""
    visit, inspected = place.visit, judged(place)
    shown = inspected.registration
    assert shown.inputs is not None
    data = collect(
        shown, shown.inputs, deviations=inspected.deviations, decision=inspected.decision, inspection=inspected.sheet
    )
    data = dataclasses.replace(data, labels=(*data.labels, *_badges(place, inspected.deviations)))
    views = [f"{yaw:g}/{pitch:g}" for yaw, pitch in visit.views]
    write_page(place.folder / REPORT, to_html(shown, data, inspected.sheet, dict(visit.head), views=views))
    (place.folder / PDF).unlink(missing_ok=True)
    return _files(place)


def print_sheet(place: Place) -> dict[str, Any]:
    """The report that was written, as a PDF."""
    page = place.folder / REPORT
    if not page.is_file():
        write_sheet(place)
    write_page(place.folder / PDF, page.read_text(encoding="utf-8"))
    return _files(place)


def _files(place: Place) -> dict[str, Any]:
    names = [REPORT, PDF, RESULT, *([PLAN] if is_judged(place.visit) else [])]
    if place.visit.start not in ("none", "identity"):
        names.append(START)
    names.append(cleaned_name(place.visit) or "")
    return {"files": [name for name in names if name and (place.folder / name).is_file()]}


def _labels(place: Place, found: Deviations) -> list[dict[str, Any]]:
    """Deviation at each place that was labelled; None where the scan has no points."""
    values = measured_at(place, found, np.array(place.visit.labels).reshape(-1, 3))
    return [{"at": at, "value": float(value)} for at, value in zip(place.visit.labels, values, strict=True)]


def _badges(place: Place, found: Deviations) -> list[Label]:
    """The places that were labelled, for the pictures of the report."""
    seen = [(each["at"], each["value"]) for each in _labels(place, found) if np.isfinite(each["value"])]
    unit = found.units or ""
    return [
        Label(f"{value:+.3g}".replace("-", "−"), np.array(at), f"{value:+.4g} {unit}".rstrip(), "tag")
        for at, value in seen
    ]


def _drawing(place: Place, found: Deviations, limit: float | None) -> dict[str, Any]:
    """The points in their colours, under the pose, in the drawing of the part."""
    frame, on = frame_of(place.part()), found.counted
    rows = rows_to_draw(found.points - found.origin, on)
    words, data = cloud_payload(found.points, frame, rows)
    sizes = np.abs(found.values[on])
    if limit is None:
        limit = nice_above(float(np.quantile(sizes, COLOUR_QUANTILE))) if len(sizes) else 1.0
    scale = Scale(limit, found.signed)
    allowed = None if found.allowed is None else found.allowed.of(rows[0])
    values, step = found.values[rows[0]], found.reach / 32767.0 if np.isfinite(found.reach) else limit / 1000.0
    data += b"\0" * (-len(data) % 4) + np.clip(np.rint(values / step), -32767, 32767).astype("<i2").tobytes()
    data += b"\0" * (-len(data) % 4) + scale.codes(values, allowed).tobytes()
    place.write("judged.bin", data)
    gradient = {"low": scale.low, "high": scale.limit, "table": scale.table().ravel().tolist(), "signed": scale.signed}
    stand = drawn_pose(np.eye(4), 1.0, frame, frame)
    return words | {"file": "judged.bin", "step": step, "scale": gradient, "drawn": stand}
