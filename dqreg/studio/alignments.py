"""The alignment that the judgement rests on: best fit, chosen faces, datums A, B, C, or reference points."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.inspection import (
    Deviations,
    Face,
    FaceTerms,
    Inspection,
    PointAlignment,
    SurfaceAlignment,
    align_points,
    align_surface,
    inspect,
    read_plan,
)
from dqreg.inspection.regions import cut_of, regions_of
from dqreg.registration.result import Registration
from dqreg.studio.aligning import result_of
from dqreg.studio.kept import Place, kept
from dqreg.studio.reading import faces_of_part, measure
from dqreg.studio.words import plan_text

# Normals of datums turn from each other by more than this cosine.
SQUARE = 0.1
# A place of the part is measured by the median of so many points; farther off than that many spacings it was not.
AROUND, SPACINGS = 25, 12.0
# Faces that a plan names at most, the ones with the most points first.
PLANNED = 60
PLAN = "plan.toml"
NAMES = {"faces": "chosen faces", "datums": "datums", "points": "reference points"}


def deviations_of(place: Place, result: Registration) -> Deviations:
    """Deviations of the scan under the pose of a result."""
    visit = place.visit

    def make() -> Deviations:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that there are no signs is said on the page
            return result.deviations(visit.tolerance, reach=visit.reach)

    return kept("deviations", [result.T_target_source, visit.cuts, visit.tolerance, visit.reach], make)


def judged(place: Place) -> tuple[Registration, Inspection | None]:
    """The registration under the alignment of the visit, and its plan carried out, where it asks for anything."""
    result, visit = result_of(place), place.visit
    if visit.alignment in ("faces", "points"):
        found = deviations_of(place, result)
        step = _on_faces(place, found) if visit.alignment == "faces" else _on_points(place, found)
        result = result.aligned(step, NAMES[visit.alignment])
    inspection = _inspected(place, result)
    if inspection is not None and inspection.alignment is not None:
        return result.aligned(inspection.alignment, NAMES["datums"]), inspection
    if visit.alignment == "datums":
        raise InputError("datums hold the part once there is something to judge: give a tolerance")
    return result, inspection


def suggest_datums(place: Place) -> dict[str, Any]:
    """Up to three planes that were scanned and stand square on each other, the largest first."""
    if not isinstance(place.part(), Mesh):
        return {"datums": []}
    scanned = set(scanned_faces(deviations_of(place, result_of(place))))
    chosen: list[Face] = []
    for face in sorted(faces_of_part(place), key=lambda face: -face.area):
        if len(chosen) < 3 and face.number in scanned and face.kind == "plane" and face.feature is not None:
            axes = [other.feature.axis for other in chosen if other.feature is not None]
            if all(abs(float(axis @ face.feature.axis)) < SQUARE for axis in axes):
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

    count = min(AROUND, len(rows))
    near, around = cKDTree(found.closest[rows] - found.origin).query(points - found.origin, k=[*range(1, count + 1)])
    far = SPACINGS * measure(place).spacing * place.scale()
    values = np.where(np.asarray(near) < far, found.values[rows][np.asarray(around)], np.nan)
    medians = np.full(len(points), np.nan)
    seen = np.isfinite(values).any(axis=1)
    medians[seen] = np.nanmedian(values[seen], axis=1)
    return medians


def _inspected(place: Place, result: Registration) -> Inspection | None:
    visit = place.visit
    if not isinstance(place.part(), Mesh) or (visit.tolerance is None and not visit.faces):
        return None
    found = deviations_of(place, result)
    text = plan_text(visit, scanned_faces(found)[:PLANNED])
    return None if text is None else inspect(found, read_plan(place.write(PLAN, text)))


def _on_faces(place: Place, found: Deviations) -> SurfaceAlignment:
    visit = place.visit
    if not visit.chosen:
        raise InputError("choose the faces that the scan is laid on")
    own = {row.face: row.tolerance for row in visit.faces}
    terms = {}
    for face in visit.chosen:
        limit = own.get(face, visit.tolerance)
        if visit.goal == "tolerance" and limit is None:
            raise InputError("a fit within the tolerances needs a tolerance: give one in the step Judge first")
        terms[face] = FaceTerms() if limit is None else FaceTerms(low=-limit, high=limit)
    return align_surface(found, visit.goal, faces=terms)


def _on_points(place: Place, found: Deviations) -> PointAlignment:
    """Reference points: each is measured along its normal and laid on its nominal place."""
    nominals = np.array([each.point for each in place.visit.references]).reshape(-1, 3)
    normals = np.array([each.normal for each in place.visit.references]).reshape(-1, 3)
    if len(nominals) < 6:
        raise InputError(f"six reference points hold the part; there are {len(nominals)}")
    offsets = measured_at(place, found, nominals)
    if np.isnan(offsets).any():
        raise InputError(f"reference point {int(np.argmax(np.isnan(offsets))) + 1} was not scanned: choose another one")
    return align_points(nominals + offsets[:, None] * normals, nominals, normals)
