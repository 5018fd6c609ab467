"""The fourth and fifth step: deviations with their colours, the decision on the part, the report and the plan."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import numpy as np

from dqreg.geometry import Mesh
from dqreg.inspection import Decision, Deviations, Face, Inspection, decide, inspect, read_plan
from dqreg.inspection.regions import cut_of, regions_of
from dqreg.registration.result import Registration
from dqreg.report.colours import Scale, nice_above
from dqreg.report.page import write_report
from dqreg.report.page_file import write_page
from dqreg.studio.aligning import RESULT, START, result_of
from dqreg.studio.cleaning import CLEANED
from dqreg.studio.drawing import cloud_payload, drawn_pose, frame_of, rows_to_draw
from dqreg.studio.kept import Place, kept
from dqreg.studio.reading import faces_of_part, measure
from dqreg.studio.words import plan_text

# Worst places that are listed, and the share of the points that the colours reach where no tolerance is given.
WORST, SHOWN = 8, 0.98
# A label is the median of so many points around its place; farther off than that many spacings it was not measured.
LABEL, LABEL_SPACINGS = 25, 12.0
# Normals of datums turn from each other by more than this cosine.
SQUARE = 0.1
# Faces that a plan names at most, the ones with the most points first.
PLANNED = 60
PLAN, REPORT, PDF = "plan.toml", "report.html", "report.pdf"


def judge(place: Place) -> dict[str, Any]:
    """The part as it was measured: figures, decision, faces, places, and the points in their colours."""
    inspection = inspected(place)
    shown = shown_result(place, inspection)
    found, tolerance = deviations_of(place, shown), place.visit.tolerance
    answer: dict[str, Any] = {
        "summary": dataclasses.asdict(found.summary()),
        "counts": dataclasses.asdict(found.counts),
        "signed": found.signed,
        "sides": found.reason,
        "unit": found.units,
        "reach": found.reach,
        "drawing": _drawing(place, found),
        "labels": _labels(place, found),
        "worst": [
            {"value": each.value, "at": each.position.tolist(), "points": each.points} for each in found.worst(WORST)
        ],
    }
    if tolerance is not None:
        decision = decide(found, tolerance, place.visit.required / 100.0)
        answer["decision"] = _without_regions(decision)
        answer["faces"] = _rows(decision.regions)
        answer["bands"] = [dataclasses.asdict(band) for band in found.bands(tolerance).rows]
    else:
        answer["faces"] = _rows(regions_of(found, cut_of(found)))
    if inspection is not None:
        answer["characteristics"] = [dataclasses.asdict(row) for row in inspection.characteristics]
        answer["characteristics_outcome"] = inspection.outcome
    return answer


def deviations_of(place: Place, result: Registration) -> Deviations:
    """Deviations of the scan under the pose of a result."""
    visit = place.visit

    def make() -> Deviations:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that there are no signs is said on the page
            return result.deviations(visit.tolerance, reach=visit.reach)

    return kept("deviations", [result.T_target_source, visit.cuts, visit.tolerance, visit.reach], make)


def inspected(place: Place) -> Inspection | None:
    """The plan of the visit carried out; None where there is nothing that a plan could ask for."""
    visit = place.visit
    if not isinstance(place.part(), Mesh) or (visit.tolerance is None and not visit.faces):
        return None
    found = deviations_of(place, result_of(place))
    cut = cut_of(found)
    scanned = () if cut.areas is None else tuple(region.number for region in regions_of(found, cut)[:PLANNED])
    text = plan_text(visit, scanned)
    if text is None:
        return None
    return inspect(found, read_plan(place.write(PLAN, text)))


def suggest_datums(place: Place) -> dict[str, Any]:
    """Up to three planes that were scanned and stand square on each other, the largest first."""
    part = place.part()
    if not isinstance(part, Mesh):
        return {"datums": []}
    found = deviations_of(place, result_of(place))
    scanned = {region.number for region in regions_of(found, cut_of(found))}
    chosen: list[Face] = []
    for face in sorted(faces_of_part(place), key=lambda face: -face.area):
        if len(chosen) < 3 and face.number in scanned and face.kind == "plane" and face.feature is not None:
            axes = [other.feature.axis for other in chosen if other.feature is not None]
            if all(abs(float(axis @ face.feature.axis)) < SQUARE for axis in axes):
                chosen.append(face)
    return {"datums": [face.number for face in chosen]}


def shown_result(place: Place, inspection: Inspection | None) -> Registration:
    """The registration as it is judged: under the pose of the datums, where the visit has them."""
    result = result_of(place)
    if inspection is None or inspection.alignment is None:
        return result
    return dataclasses.replace(result, T_target_source=inspection.alignment.T_target_source @ result.T_target_source)


def write_sheet(place: Place) -> dict[str, Any]:
    """Write the report, and the plan where there is one."""
    visit, inspection = place.visit, inspected(place)
    shown = shown_result(place, inspection)
    options: dict[str, Any] = {"reach": visit.reach, "required_share": visit.required / 100.0}
    options["deviations"] = deviations_of(place, shown)
    write_report(shown, place.folder / REPORT, visit.tolerance, inspection=inspection, **options)
    (place.folder / PDF).unlink(missing_ok=True)
    return _files(place, planned=inspection is not None)


def print_sheet(place: Place) -> dict[str, Any]:
    """The report that was written, as a PDF."""
    page = place.folder / REPORT
    if not page.is_file():
        write_sheet(place)
    write_page(place.folder / PDF, page.read_text(encoding="utf-8"))
    return _files(place, planned=inspected(place) is not None)


def _files(place: Place, *, planned: bool) -> dict[str, Any]:
    names = [REPORT, PDF, RESULT, *([PLAN] if planned else [])]
    if place.visit.start not in ("none", "identity"):
        names.append(START)
    if place.visit.cuts:
        names.append(CLEANED)
    return {"files": [name for name in names if (place.folder / name).is_file()]}


def _labels(place: Place, found: Deviations) -> list[dict[str, Any]]:
    """Deviation at each place that was labelled; None where the scan has no points."""
    places = place.visit.labels
    rows = np.flatnonzero(found.counted)
    if not places or not len(rows):
        return [{"at": at, "value": None} for at in places]
    from scipy.spatial import cKDTree

    near, around = map(
        np.asarray, cKDTree(found.closest[rows] - found.origin).query(np.array(places) - found.origin, k=LABEL)
    )
    far = LABEL_SPACINGS * measure(place).spacing * place.scale()
    return [
        {
            "at": at,
            "value": None if near[k, 0] > far else float(np.median(found.values[rows[around[k][near[k] < far]]])),
        }
        for k, at in enumerate(places)
    ]


def _drawing(place: Place, found: Deviations) -> dict[str, Any]:
    """The points in their colours, under the pose, in the drawing of the part."""
    frame, on = frame_of(place.part()), found.counted
    rows = rows_to_draw(found.points - found.origin, on)
    words, data = cloud_payload(found.points, frame, rows)
    limit = place.visit.tolerance
    sizes = np.abs(found.values[on])
    if limit is None:
        limit = nice_above(float(np.quantile(sizes, SHOWN))) if len(sizes) else 1.0
    scale = Scale(limit, found.signed)
    values, step = found.values[rows[0]], found.reach / 32767.0 if np.isfinite(found.reach) else limit / 1000.0
    data += b"\0" * (-len(data) % 4) + np.clip(np.rint(values / step), -32767, 32767).astype("<i2").tobytes()
    data += b"\0" * (-len(data) % 4) + scale.codes(values).tobytes()
    place.write("judged.bin", data)
    gradient = {"low": scale.low, "high": scale.limit, "table": scale.table().ravel().tolist(), "signed": scale.signed}
    stand = drawn_pose(np.eye(4), 1.0, frame, frame)
    return words | {"file": "judged.bin", "step": step, "scale": gradient, "drawn": stand}


def _rows(regions: Any) -> list[dict[str, Any]]:
    return [dataclasses.asdict(region) for region in regions]


def _without_regions(decision: Decision) -> dict[str, Any]:
    found = dataclasses.asdict(decision)
    found.pop("regions")
    return found
