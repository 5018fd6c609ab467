"""What a report says of the scan on the part: figures, deviations, regions; plain values for the template."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.inspection import Deviations
from dqreg.report.charts import NARROW_CANVAS, WIDE_CANVAS, histogram
from dqreg.report.report_data import ReportData
from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.text import (
    in_unit,
    percent,
    percent_asked,
    place_text,
    scale_end,
    text_of,
    tolerance_text,
    unit_words,
)

ADVICE = {
    "accepted": "The pose can be used.",
    "suspect": "Look at the reasons before the pose is used.",
    "failed": "No pose was found; there is nothing to use.",
}
# What the reach follows from.
REACH_FROM = {
    "given": "as given with --reach",
    "size": "0.05 of the smaller size",
    "noise": "6 sigma of the scan's noise; no point that counts lies farther off",
    "spacing": "one spacing of the scan; no point that counts lies farther off",
    "deviations": "its largest deviation found in the scan",
}
SIGNS = {"accepted": "✓", "suspect": "!", "failed": "✗"}


def noun_of(data: ReportData | None) -> str:
    """What the target is called: another scan is no part."""
    return "part" if data is None or isinstance(data.inputs.target.geometry, Mesh) else "target"


def tiles_of(result: RegistrationResult, data: ReportData | None, unit: str) -> list[tuple[str, str, str]]:
    """The few numbers that matter most: name, value, remark."""
    if not np.isfinite(result.rms):
        return []
    settings, noun = result.settings, noun_of(data)
    tiles: list[tuple[str, str, str]] = []
    if data is not None and data.deviations is not None:
        summary = data.deviations.summary()
        total = summary.count + summary.beyond
        tiles.append(
            ("Root mean square", f"{text_of(summary.rms)}{unit_words(unit)}", f"deviation of the points on the {noun}")
        )
        tiles.append(("95 % of them within", f"{text_of(summary.p95)}{unit_words(unit)}", "absolute deviation"))
        tiles.append(
            (f"On the {noun}", f"{percent(summary.count / total)} %", f"{summary.count:,} of {total:,} points")
        )
        if data.decision is not None:
            words = f"of the points on the {noun}; {percent_asked(data.decision.required_share)} % are required"
            within = f"Within {tolerance_text(data.decision, unit)}"
            tiles.insert(0, (within, f"{percent(data.decision.share_within)} %", words))
    else:
        tiles.append(("Scan to target, rms", f"{text_of(result.rms)}{unit_words(unit)}", "distance of the inliers"))
        tiles.append(("Points used", f"{settings.get('used_points', 0):,}", f"of {settings.get('source_points', 0):,}"))
    if result.observability:
        weakest = result.observability[0]
        known = f"{text_of(weakest.sigma, 2)}{unit_words(unit)}" if np.isfinite(weakest.sigma) else "unconstrained"
        tiles.append(("Pose, weakest motion", known, f"one sigma on the {noun}"))
    return tiles


def deviations_of(data: ReportData) -> dict[str, Any] | None:
    """Histogram, figures and bands."""
    found, scale = data.deviations, data.scale
    if found is None or scale is None:
        return None
    summary, unit = found.summary(), data.unit
    figures = [
        ("Mean", f"{text_of(summary.mean, sign=found.signed)}{unit_words(unit)}"),
        ("Root mean square", f"{text_of(summary.rms)}{unit_words(unit)}"),
        ("Median, absolute", f"{text_of(summary.p50)}{unit_words(unit)}"),
        ("95 % within", f"{text_of(summary.p95)}{unit_words(unit)}"),
        ("99 % within", f"{text_of(summary.p99)}{unit_words(unit)}"),
        ("Largest", f"{text_of(summary.max)}{unit_words(unit)}"),
    ]
    return {
        "words": f"Distance of every scan point from the closest point of the target; {found.reason}.",
        "chart": "".join(
            histogram(found.values[found.counted], scale, unit, data.limits, size)
            for size in (WIDE_CANVAS, NARROW_CANVAS)
        ),
        "figures": figures,
        "counts": counts_rows(found, unit),
    }


def counts_rows(found: Deviations, unit: str) -> list[tuple[str, str, str, str]]:
    """What the points of the scan belong to: name, number, share of the scan, remark; numbers and shares add up."""
    counts, noun = found.counts, "part" if isinstance(found.target, Mesh) else "target"
    rows = [
        ("Points of the scan", counts.total, ""),
        ("Excluded", -counts.excluded, "in a box that was left out"),
        ("Beyond reach", -counts.beyond_reach, reach_words(found, unit)),
        ("Other surfaces", -counts.other_surfaces, f"within reach, of a surface off the {noun}: a table, a clamp"),
        ("Outliers", -counts.outliers, "within reach, single points off every surface"),
        (f"On the {noun}", counts.on_part, "all figures are of these"),
    ]
    return [
        (name, f"{number:,}".replace("-", "− "), f"{percent(abs(number) / max(counts.total, 1))} %", words)
        for name, number, words in rows
        if number or name in ("Points of the scan", f"On the {noun}")
    ]


def reach_words(found: Deviations, unit: str) -> str:
    """How far the part goes, and what that follows from."""
    far = f"farther than {text_of(found.reach, 4)}{unit_words(unit)} from the part"
    return f"{far}: {REACH_FROM[found.reach_from]}"


def scale_words(data: ReportData) -> dict[str, Any] | None:
    """The legend of the view."""
    if data.scale is None or data.deviations is None:
        return None
    gradient, below, above = data.scale.css()
    marks = np.linspace(data.scale.low, data.scale.limit, 5)
    words = (
        in_unit("deviation", data.unit) + ", + outside the part"
        if data.scale.signed
        else in_unit("distance", data.unit)
    )
    if data.tolerance is not None:
        out = "out of it" if data.limits is not None else "out of the tolerance of their face"
        words += f"; the scale ends at {scale_end(data.limits)}, dark points are {out}"
    else:
        words += "; dark ends: beyond the scale"
    return {
        "gradient": gradient,
        "below": below if data.scale.signed else "transparent",
        "above": above,
        "marks": [text_of(float(mark), sign=data.scale.signed) for mark in marks],
        "words": words,
    }


def worst_of(data: ReportData) -> list[dict[str, Any]]:
    """Rows of the worst places."""
    signed = data.deviations is not None and data.deviations.signed
    return [
        {
            "value": text_of(place.value, sign=signed),
            "points": f"{place.points:,}",
            "at": place_text(rounded(place.position, data.size)),
            "goto": goto(place.position - data.origin, data.size),
        }
        for place in data.worst
    ]


def rounded(point: FloatArray, size: float) -> FloatArray:
    """A place to a ten-thousandth of the part: more digits say nothing of where a patch is."""
    step = 10.0 ** np.floor(np.log10(size * 1e-4))
    rounded: FloatArray = np.round(point / step) * step
    return rounded


def goto(centred: FloatArray, size: float) -> str:
    """A place for the view's scripts."""
    return "[" + ",".join(f"{x:.5f}" for x in centred / size) + "]"


def drawn_words(data: ReportData, scene: dict[str, Any]) -> str:
    """How much of the data the view draws."""
    points, total = scene["on"]["count"] + scene["off"]["count"], len(data.points)
    words = [f"Drawn: {points:,} of {total:,} scan points; all of them are in the numbers."]
    if points == total:
        words = [f"Drawn: all {total:,} scan points."]
    target = scene["target"]
    if target["kind"] == "mesh" and target["drawn"] < target["total"]:
        words.append(f"The part is drawn with {target['drawn']:,} of its {target['total']:,} triangles.")
    return " ".join(words)
