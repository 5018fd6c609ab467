"""The alignment that the judgement rests on: best fit, chosen faces, datums A, B, C, or reference points."""

from __future__ import annotations

import dataclasses
import tomllib
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.inspection import Deviations, Face
from dqreg.inspection.decision.places import PLACE_POINTS
from dqreg.inspection.decision.regions import cut_of, regions_of
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.plan.suggested_datums import PERPENDICULAR_COS
from dqreg.registration.result.part_inspection import Inspected, inspect_registration
from dqreg.studio.aligning import result_of
from dqreg.studio.plans import is_judged, plan_text
from dqreg.studio.reading import faces_of_part, measure
from dqreg.studio.visit import PLAN, Visit
from dqreg.studio.worker_cache import Place, cached

# A place of the part that is farther than that many spacings from the points around it was not measured.
REACH_SPACINGS = 12.0


def deviations_of(place: Place) -> Deviations:
    """Deviations of the scan as it was registered."""
    result, reach = result_of(place), place.visit.reach
    return cached(
        "deviations",
        [result.T_target_source, place.visit.cuts, reach],
        lambda: inspect_registration(result, reach=reach).deviations,
    )


def judged(place: Place) -> Inspected:
    """The registration under the alignment of the visit, with its deviations, its sections and its decision."""
    result, visit = result_of(place), place.visit
    _require_chosen(visit)
    text = plan_text(visit)
    if is_judged(visit):
        place.write(PLAN, text)
    else:
        (place.folder / PLAN).unlink(missing_ok=True)

    def make() -> Inspected:
        plan = None
        if isinstance(place.part(), Mesh) and (is_judged(visit) or visit.sections or visit.alignment != "best-fit"):
            # A plan in a file decides something; on the page an alignment or a section can be looked at before.
            asked = {} if is_judged(visit) else {"tolerance": 1.0}
            plan = plan_of(asked | tomllib.loads(text))
            plan = plan if is_judged(visit) else dataclasses.replace(plan, tolerance=None)
        return inspect_registration(result, plan, reach=visit.reach)

    return cached("judged", [result.T_target_source, visit.cuts, visit.reach, text], make)


def _require_chosen(visit: Visit) -> None:
    """`InputError` where an alignment was chosen and what it needs was not."""
    if visit.alignment == "faces":
        if not visit.chosen:
            raise InputError("choose the faces that the scan is laid on")
        if visit.goal == "tolerance" and visit.tolerance is None:
            raise InputError("a fit within the tolerance needs one for the whole part: give it in the step Judge first")
    if visit.alignment == "datums" and not visit.datums:
        raise InputError("choose the faces of datums A, B and C")
    if visit.alignment == "points" and len(visit.references) < 6:
        raise InputError(f"six reference points hold the part; there are {len(visit.references)}")


def suggest_datums(place: Place) -> dict[str, Any]:
    """Up to three planes that were scanned and stand square on each other, the largest first."""
    if not isinstance(place.part(), Mesh):
        return {"datums": []}
    scanned = set(scanned_faces(deviations_of(place)))
    chosen: list[Face] = []
    for face in sorted(faces_of_part(place), key=lambda face: -face.area):
        if len(chosen) < 3 and face.number in scanned and face.kind == "plane" and face.feature is not None:
            axes = [other.feature.axis for other in chosen if other.feature is not None]
            if all(abs(float(axis @ face.feature.axis)) < PERPENDICULAR_COS for axis in axes):
                chosen.append(face)
    return {"datums": [face.number for face in chosen]}


def scanned_faces(found: Deviations) -> tuple[int, ...]:
    """Faces of the part that were scanned, the one with the most points first; none where it has no faces."""
    cut = cut_of(found)
    return () if cut.areas is None else tuple(region.number for region in regions_of(found, cut))


def measured_at(place: Place, found: Deviations, points: FloatArray) -> FloatArray:
    """Deviation at places of the part, (n,): medians of the points around; NaN where the scan has none."""
    rows = np.flatnonzero(found.counted)
    if not len(rows) or not len(points):
        return np.full(len(points), np.nan)
    from scipy.spatial import cKDTree

    count = min(PLACE_POINTS, len(rows))
    near, around = cKDTree(found.closest[rows] - found.origin).query(points - found.origin, k=[*range(1, count + 1)])
    far = REACH_SPACINGS * measure(place).spacing * place.scale()
    values = np.where(np.asarray(near) < far, found.values[rows][np.asarray(around)], np.nan)
    medians = np.full(len(points), np.nan)
    seen = np.isfinite(values).any(axis=1)
    medians[seen] = np.nanmedian(values[seen], axis=1)
    return medians
