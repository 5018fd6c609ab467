"""The report as one HTML file: opens anywhere, loads nothing, prints to PDF."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._numbers import is_whole
from dqreg.errors import InputError
from dqreg.files.strict_json import plain
from dqreg.inspection import Decision, Deviations, Inspection, PlannedReport
from dqreg.report import page_tables as tables
from dqreg.report.cameras import VIEWS
from dqreg.report.charts import NARROW_CANVAS, WIDE_CANVAS, convergence
from dqreg.report.colours import LEVELS
from dqreg.report.decision_tables import bands_of, decision_of, regions_table, shape_words
from dqreg.report.facts import facts_of, file_name, motions_of
from dqreg.report.figure import encode
from dqreg.report.hints import hints_of, remarks_of
from dqreg.report.html import data_uri, render
from dqreg.report.page_file import page_path, write_page
from dqreg.report.pictures import PicturePanel, draw
from dqreg.report.report_data import ReportData, checked_tolerance, collect, unit_of
from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.sheet import digests_of, head_rows, sheet_of
from dqreg.report.summary import ALIGNMENT, confidence_words
from dqreg.report.text import pose_forms, text_of, unit_words
from dqreg.report.view3d import ELLIPSOID_DIAGONALS, scene_of

# Pixels of one panel of the picture for print.
PANEL_WIDTH, PANEL_HEIGHT = 760, 540
# The same of the one or two panels in a notebook.
NOTEBOOK_WIDTH, NOTEBOOK_HEIGHT = 520, 380
# Pixels that a cell of a notebook may be high.
MIN_CELL_HEIGHT, MAX_CELL_HEIGHT = 200, 4000
NO_SIDES = (
    "No view: this result does not hold the scan and the target. Attach them, result.attached(scan, target), before "
    "the report is written; dqreg show does so with --source and --target."
)


def write_report(
    result: RegistrationResult,
    path: str | Path,
    tolerance: float | None = None,
    *,
    reach: float | None = None,
    start: ArrayLike | None = None,
    deviations: Deviations | None = None,
    decision: Decision | None = None,
) -> Path:
    """Write the report of a registration, whole or not at all; a decision that was made is shown as it is."""
    goal = page_path(path)
    checked_tolerance(tolerance)
    data = None
    if result.inputs is not None:
        data = collect(result, result.inputs, tolerance, start, reach, deviations, decision=decision)
    return write_page(goal, to_html(result, data))


def to_html(
    result: RegistrationResult,
    data: ReportData | None,
    inspection: Inspection | None = None,
    head: Mapping[str, str] | None = None,
    *,
    in_cell: bool = False,
    views: Sequence[str] = (),
) -> str:
    """The page of a result; ``head`` names the part and who measured it, ``views`` the pictures for print.

    A cell has the verdict and the view alone.
    """
    from markupsafe import Markup

    unit = unit_of(result)
    asked = inspection.plan.report if inspection else PlannedReport()
    trusted = result.verdict.level == "accepted"
    shown = _shown(data, views or asked.views, printed=not in_cell, trusted=trusted)
    values = _words(result, data, unit) | _evidence(result, unit) | shown
    values["in_cell"], values["parts"] = in_cell, asked.parts
    if "view" not in asked.parts:
        values["scene"] = ""
    values["inspection"] = sheet_of(inspection, unit, trusted=trusted)
    values["head_rows"] = head_rows({**(inspection.plan.head if inspection else {}), **(head or {})})
    values["digests"] = digests_of(result.settings)
    # Made by this package from numbers and escaped words.
    for name in ("convergence", "scene"):
        values[name] = Markup(values[name])
    if values["deviations"] is not None:
        values["deviations"]["chart"] = Markup(values["deviations"]["chart"])
    return render("report.html", **values)


def _words(result: RegistrationResult, data: ReportData | None, unit: str) -> dict[str, Any]:
    level = result.verdict.level
    settings = result.settings
    return {
        "level": level,
        "alignment": ALIGNMENT[level],
        "sign": tables.SIGNS[level],
        "advice": tables.ADVICE[level],
        "reasons": (*result.verdict.reasons, *remarks_of(result)),
        "confidence": confidence_words(result),
        "in_shape": shape_words(result),
        "hints": hints_of(result),
        "source": file_name(settings.get("source")),
        "target": file_name(settings.get("target")),
        "written": time.strftime("%Y-%m-%d %H:%M"),
        "unit": unit,
        "unit_known": settings.get("target_units") is not None,
        "tiles": tables.tiles_of(result, data, unit),
        "noun": tables.noun_of(data),
        # Against another scan it is the scan that is judged.
        "judged": "part" if tables.noun_of(data) == "part" else "scan",
        "data": data is not None,
        "why_no_view": NO_SIDES,
    }


def _evidence(result: RegistrationResult, unit: str) -> dict[str, Any]:
    found = bool(np.isfinite(result.T_target_source).all())
    seconds = result.timings.get("total")
    steps = len(result.history)
    ran = f"{result.status} after {steps} iteration{'' if steps == 1 else 's'}"
    if np.isfinite(result.rms):
        ran += f", rms distance of the inliers {text_of(result.rms)}{unit_words(unit)}"
    return {
        **facts_of(result, unit),
        "sure_words": "Six independent motions of the part, the weakest first, with the standard deviation along each."
        + (" They are those of the registration, before the alignment." if result.settings.get("alignments") else ""),
        "forms": pose_forms(result.T_target_source, unit) if found else [],
        "alternatives": [
            {
                "words": f"Score {text_of(other.score)}{unit_words(unit)}: truncated rms distance of the scan; smaller "
                "is better.",
                "text": pose_forms(other.T_target_source, unit)[0].text,
            }
            for other in result.alternatives
        ],
        "run_words": f"The loop ended: {ran}{'' if seconds is None else f', {seconds:.2f} s in all'}.",
        "convergence": "".join(
            convergence(result.history, unit, size) for size in (WIDE_CANVAS, NARROW_CANVAS) if result.history
        ),
    }


def _shown(data: ReportData | None, views: Sequence[str], *, printed: bool, trusted: bool) -> dict[str, Any]:
    """What only a result with source and target can show."""
    if data is None:
        return {
            "deviations": None,
            "bands": None,
            "decision": None,
            "worst": [],
            "scene": "",
            "scale": None,
            "regions": None,
            "iterations": 0,
        }
    scene = scene_of(data)
    poses = [{"short": pose["name"], **pose} for pose in scene["poses"] if pose["kind"] != "iteration"]
    checked = "after" if data.found else "before"
    for pose in poses:
        pose["checked"] = pose["kind"] == checked
    return {
        "deviations": tables.deviations_of(data),
        "bands": bands_of(data),
        "decision": decision_of(data, trusted=trusted),
        "regions": regions_table(data),
        "worst": tables.worst_of(data),
        "scale": tables.scale_words(data),
        "poses": poses,
        "iterations": sum(pose["kind"] == "iteration" for pose in scene["poses"]),
        "off_shown": scene["off"]["count"] > 0,
        "labels_shown": bool(scene["labels"]),
        "drawn": tables.drawn_words(data, scene),
        "ellipsoid_words": _ellipsoid_words(data),
        "picture": data_uri(encode(draw(data, panels_of(data, views), PANEL_WIDTH, PANEL_HEIGHT), "jpeg"), "jpeg")
        if printed
        else "data:,",
        "picture_alt": "Part and scan before and after, and the deviations in colours, from several sides",
        "scene": _json(scene),
    }


def panels_of(data: ReportData, views: Sequence[str] = ()) -> list[PicturePanel]:
    """The panels of the picture for print: before and the deviations from three sides, or from those asked for."""
    if not data.found:
        return [PicturePanel("before", "best"), PicturePanel("before", "top")]
    if views:
        return [PicturePanel("deviation", view) for view in views]
    yaw, pitch = VIEWS[data.view]
    behind = next(name for name, angles in VIEWS.items() if angles == ((yaw + 180.0) % 360.0, pitch))
    first = PicturePanel("before", "best") if data.T_before is not None else PicturePanel("after", "best")
    return [
        first,
        PicturePanel("deviation", "best"),
        PicturePanel("deviation", behind),
        PicturePanel("deviation", "top"),
    ]


def _ellipsoid_words(data: ReportData) -> str:
    axes = data.ellipsoid
    if axes is None:
        return "No ellipsoid is drawn: some motion is unconstrained."
    lengths = np.sort(np.linalg.norm(axes, axis=1))[::-1]
    larger = ELLIPSOID_DIAGONALS * data.size / lengths[0]
    words = ", ".join(text_of(length, 2) for length in lengths)
    return (
        f"The ellipsoid is where the centre of the part may be, one sigma, drawn {larger:,.0f} times its size: its "
        f"semi-axes are {words}{unit_words(data.unit)}."
    )


def _json(scene: dict[str, Any]) -> str:
    # Inside a script element nothing is unescaped but "</script": no "<" is let through.
    text = json.dumps(plain(scene), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def notebook_html(result: RegistrationResult) -> str:
    """What a notebook shows: verdict, numbers and, with source and target, a picture."""
    data = None if result.inputs is None else collect(result, result.inputs)
    level = result.verdict.level
    rows = [(name, f"{value} ({more})") for name, value, more in tables.tiles_of(result, data, unit_of(result))]
    rows += [("Weakest motion", motion["words"]) for motion in motions_of(result)[:1]]
    rows += [("Equally likely poses", str(len(result.alternatives)))] if result.alternatives else []
    picture = None
    if data is not None:
        states = ("before", "deviation") if data.found and data.T_before is not None else ("deviation",)
        drawn = draw(data, [PicturePanel(state, "best") for state in states], NOTEBOOK_WIDTH, NOTEBOOK_HEIGHT)
        picture = data_uri(encode(drawn, "jpeg"), "jpeg")
    words = {"level": level, "colour": LEVELS[level], "sign": tables.SIGNS[level], "advice": tables.ADVICE[level]}
    return render("notebook.html", **words, reasons=result.verdict.reasons, rows=rows, picture=picture)


@dataclasses.dataclass(frozen=True)
class NotebookCell:
    """A page that a notebook shows in a frame of its own."""

    html: str  # The page, whole
    height: int  # Of the frame, pixels

    def _repr_html_(self) -> str:
        # Without "allow-same-origin" the page cannot touch the notebook.
        return (
            f'<iframe sandbox="allow-scripts" title="part and scan" srcdoc="{escape(self.html)}" '
            f'style="width:100%;height:{self.height}px;border:0"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Cell({self.height} pixels high)"

    def save(self, path: str | Path) -> Path:
        """Write the page alone."""
        return write_page(page_path(path), self.html)


def cell_of(
    result: RegistrationResult, tolerance: float | None, *, height: int, reach: float | None, start: Any
) -> NotebookCell:
    """The view of a result that holds its sides."""
    checked_tolerance(tolerance)
    if not is_whole(height) or not MIN_CELL_HEIGHT <= height <= MAX_CELL_HEIGHT:
        raise InputError(
            f"height must be a whole number of pixels from {MIN_CELL_HEIGHT} to {MAX_CELL_HEIGHT}; got {height!r:.60}"
        )
    if result.inputs is None:
        raise InputError(NO_SIDES)
    return NotebookCell(to_html(result, collect(result, result.inputs, tolerance, start, reach), in_cell=True), height)
