"""The fourth and fifth step: deviations with their colours, the decision on the part, the report and the plan."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import numpy as np

from dqreg.inspection import Deviations, Inspection, decide, inspect, read_plan
from dqreg.inspection.regions import cut_of, regions_of
from dqreg.registration.result import Registration
from dqreg.report.colours import Scale, nice_above
from dqreg.report.page import write_report
from dqreg.studio.aligning import result_of
from dqreg.studio.drawing import cloud_payload, drawn_pose, frame_of, rows_to_draw
from dqreg.studio.kept import Place, kept
from dqreg.studio.words import plan_text

# Worst places that are listed, and the share of the points that the colours reach where no tolerance is given.
WORST, SHOWN = 8, 0.98
PLAN, REPORT = "plan.toml", "report.html"


def deviations_of(place: Place) -> Deviations:
    """Deviations of the registered scan."""
    result, visit = result_of(place), place.visit

    def make() -> Deviations:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that there are no signs is said on the page
            return result.deviations(visit.tolerance, reach=visit.reach)

    return kept("deviations", [id(result), visit.tolerance, visit.reach], make)


def judge(place: Place) -> dict[str, Any]:
    """The part as it was measured: figures, decision, faces, places, and the points in their colours."""
    result, found = result_of(place), deviations_of(place)
    summary, tolerance = found.summary(), place.visit.tolerance
    answer: dict[str, Any] = {
        "summary": dataclasses.asdict(summary),
        "counts": dataclasses.asdict(found.counts),
        "signed": found.signed,
        "sides": found.reason,
        "unit": found.units,
        "reach": found.reach,
        "drawing": _drawing(place, result, found),
        "worst": [
            {"value": each.value, "at": each.position.tolist(), "points": each.points} for each in found.worst(WORST)
        ],
    }
    if tolerance is not None:
        decision = decide(found, tolerance, place.visit.required / 100.0)
        answer |= {"decision": _plain_decision(decision), "faces": _rows(decision.regions)}
        answer["bands"] = [dataclasses.asdict(band) for band in found.bands(tolerance).rows]
    else:
        answer["faces"] = _rows(regions_of(found, cut_of(found)))
    inspection = inspected(place)
    if inspection is not None:
        answer["characteristics"] = [dataclasses.asdict(row) for row in inspection.characteristics]
        answer["characteristics_outcome"] = inspection.outcome
    return answer


def inspected(place: Place) -> Inspection | None:
    """The plan of the visit carried out; None where it asks for nothing but the overall tolerance."""
    text = plan_text(place.visit)
    if text is None:
        return None
    path = place.write(PLAN, text)
    return inspect(deviations_of(place), read_plan(path))


def write_sheet(place: Place) -> dict[str, Any]:
    """Write the report, and the plan where there is one."""
    result, visit = result_of(place), place.visit
    inspection = inspected(place)
    shown = _under_datums(result, inspection)
    options: dict[str, Any] = {"reach": visit.reach, "required_share": visit.required / 100.0}
    deviations = deviations_of(place) if shown is result else None
    write_report(shown, place.folder / REPORT, visit.tolerance, deviations=deviations, inspection=inspection, **options)
    files = [REPORT, "result.json"] + ([PLAN] if inspection is not None else [])
    return {"files": [name for name in files if (place.folder / name).is_file()]}


def _under_datums(result: Registration, found: Inspection | None) -> Registration:
    if found is None or found.alignment is None:
        return result
    return dataclasses.replace(result, T_target_source=found.alignment.T_target_source @ result.T_target_source)


def _drawing(place: Place, result: Registration, found: Deviations) -> dict[str, Any]:
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


def _plain_decision(decision: Any) -> dict[str, Any]:
    found = dataclasses.asdict(decision)
    found.pop("regions")
    return found
