"""The alignment that a sheet's values are of: each step with what it is laid on, and what it moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg.inspection import AlignedStep, DatumAlignment, Inspection, PointAlignment
from dqreg.inspection.plan.alignment import PlannedStep
from dqreg.report.text import percent, text_of
from dqreg.rigid import pose

# What each kind of step does, in one line.
KINDS = {
    "datums": "laid on the datums in their order",
    "points": "reference points (RPS), least squares along their directions",
    "best-fit": "least squares",
    "tolerance": "most points within the band",
    "minimax": "smallest largest deviation",
    "outside": "best fit with no place below the part's surface",
    "inside": "best fit with no place above the part's surface",
}


def alignment_of(found: Inspection, unit: str) -> dict[str, Any]:
    """Steps of the alignment for the template, and what a best fit without steps is."""
    rows, before = [], np.eye(4)
    for step, planned in zip(found.steps, _planned(found, unit) if found.steps else [], strict=True):
        moved = step.T_target_source @ pose.inverse(before)
        before = step.T_target_source
        middle = step.alignment.centre
        turn = float(np.rad2deg(pose.angle_between(moved, np.eye(4))))
        shift = float(np.linalg.norm(moved[:3, :3] @ middle + moved[:3, 3] - middle))
        rows.append([step.name, KINDS[step.kind], planned, _result(step, unit), text_of(turn, 3), text_of(shift, 3)])
    columns = [("Step", "", False), ("What", "", False), ("On", "", False), ("Result", "", False),
               ("Rotation", "degrees", True), ("Translation", unit, True)]  # fmt: skip
    words = (
        "Rotation and translation of the part's middle are those of the step, from the pose before it; the first "
        "starts from the registration, a best fit of the whole scan."
    )
    if not rows:
        words = "The best fit of the whole scan: least squares of all points on the part, outliers weighed down."
    return {"columns": columns, "rows": rows, "words": words}


def _planned(found: Inspection, unit: str) -> list[str]:
    """What each step of the plan is laid on, in words."""
    datums = ", ".join(
        f"{datum.name}: {_face(datum.face)}" + ("" if datum.fit == "gauss" else f" ({datum.fit})")
        for datum in found.plan.datums
    )
    if not found.plan.steps:
        return [datums] * len(found.steps)
    words = []
    for step in found.plan.steps:
        weights = step.weights or ("",) * len(step.faces)
        faces = ", ".join(
            _face(face) + (f" x {weight:g}" if weight else "") for face, weight in zip(step.faces, weights, strict=True)
        )
        on = {"datums": datums, "points": f"{len(step.points)} points"}.get(step.kind, faces or "all faces")
        band = "" if step.band is None else f"; {step.band[0]:+g} to {step.band[1]:+g}"
        words.append(on + band + ("" if step.dof == "all" else f"; free: {step.dof}") + _known(step, unit))
    return words


def _known(step: PlannedStep, unit: str) -> str:
    """The prior of a step in words."""
    if step.prior is None:
        return ""
    turns, shifts = (
        " ".join(f"{x:g}" for x in (each[:1] if len(set(each)) == 1 else each))
        for each in (step.prior.rotation_deg, step.prior.translation)
    )
    return f"; prior: sigma {turns} degrees, {shifts} {unit}"


def _face(name: int | tuple[float, ...]) -> str:
    if isinstance(name, int):
        return f"face {name}"
    return ("near " if len(name) == 3 else "box ") + " ".join(f"{x:g}" for x in name)


def _result(step: AlignedStep, unit: str) -> str:
    found = step.alignment
    if isinstance(found, DatumAlignment):
        fixed = ", ".join(f"{letter} fixes {count}" for letter, count in found.constrained.items())
        return f"{fixed} of six motions"
    if isinstance(found, PointAlignment):
        return f"largest residual {text_of(float(np.abs(found.residuals).max()), 2)} {unit}"
    share = "" if found.share_within is None else f", {percent(found.share_within)} % within the band"
    sizes = f"rms {text_of(found.rms, 2)} {unit}, largest {text_of(found.largest, 2)} {unit}"
    return f"{found.points:,} points, {sizes}{share}"
