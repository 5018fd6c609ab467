"""What a report says of the scan on the part: figures, deviations, regions; plain values for the template."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection import Band
from dqreg.report.charts import NARROW, WIDE, histogram
from dqreg.report.report_data import REQUIRED_SHARE, ReportData
from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.text import percent, place_text, text_of

ADVICE = {
    "accepted": "The pose can be used.",
    "suspect": "Look at the reasons before the pose is used.",
    "failed": "No pose was found; there is nothing to use.",
}
SIGNS = {"accepted": "✓", "suspect": "!", "failed": "✗"}


def tiles_of(result: RegistrationResult, data: ReportData | None, unit: str) -> list[tuple[str, str, str]]:
    """The few numbers that matter most: name, value, remark."""
    if not np.isfinite(result.rms):
        return []
    settings = result.settings
    tiles = [("Scan to target, rms", f"{text_of(result.rms)} {unit}", "distance of the inliers")]
    if data is not None and data.deviations is not None:
        summary = data.deviations.summary()
        total = summary.count + summary.beyond
        tiles.append(("Near the part", f"{percent(summary.count / total)} %", f"{summary.count:,} of {total:,} points"))
        tiles.append(("95 % of them within", f"{text_of(summary.p95)} {unit}", "absolute deviation"))
        if summary.share_within is not None:
            bands = data.deviations.bands(required_share=REQUIRED_SHARE)
            word = "✓ PASS" if bands.passed else "✗ FAIL"
            words = f"{percent(bands.within)} % within ±{text_of(bands.tolerance)} {unit}"
            tiles.insert(0, ("Tolerance", word, words))
    else:
        tiles.append(("Points used", f"{settings.get('used_points', 0):,}", f"of {settings.get('source_points', 0):,}"))
    if result.observability:
        weakest = result.observability[0]
        known = f"{text_of(weakest.sigma, 2)} {unit}" if np.isfinite(weakest.sigma) else "unconstrained"
        tiles.append(("Pose, weakest motion", known, "one sigma on the part"))
    return tiles


def deviations_of(data: ReportData) -> dict[str, Any] | None:
    """Histogram, figures and bands."""
    found, scale = data.deviations, data.scale
    if found is None or scale is None:
        return None
    summary, unit = found.summary(), data.unit
    figures = [
        ("Points counted", f"{summary.count:,}"),
        (f"Beyond {text_of(found.reach, 4)} {unit}", f"{summary.beyond:,}, not counted as the part's"),
        ("Mean", f"{text_of(summary.mean, sign=found.signed)} {unit}"),
        ("Root mean square", f"{text_of(summary.rms)} {unit}"),
        ("Median, absolute", f"{text_of(summary.p50)} {unit}"),
        ("95 % within", f"{text_of(summary.p95)} {unit}"),
        ("99 % within", f"{text_of(summary.p99)} {unit}"),
        ("Largest", f"{text_of(summary.max)} {unit}"),
    ]
    return {
        "words": f"Distance of every scan point from the closest point of the target; {found.reason}.",
        "chart": "".join(
            histogram(found.values[found.counted], scale, unit, data.tolerance, size) for size in (WIDE, NARROW)
        ),
        "figures": figures,
        "bands": _bands(data) if data.tolerance is not None else None,
    }


def _bands(data: ReportData) -> dict[str, Any]:
    assert data.deviations is not None
    bands = data.deviations.bands(required_share=REQUIRED_SHARE)
    rows = [
        {
            "range": _range(band),
            "count": f"{band.count:,}",
            "share": percent(band.share),
            "inside": max(abs(band.low), abs(band.high)) <= bands.tolerance,
        }
        for band in bands.rows
    ]
    needed = f"{100.0 * bands.required_share:g} %"
    words = f"{percent(bands.within)} % of the points near the part are within the tolerance; {needed} are required."
    return {"tolerance": text_of(bands.tolerance, 6), "rows": rows, "passed": bands.passed, "words": words}


def _range(band: Band) -> str:
    if np.isinf(band.low):
        return f"below {text_of(band.high, 4)}"
    if np.isinf(band.high):
        return f"above {text_of(band.low, 4)}"
    return f"{text_of(band.low, 4)} to {text_of(band.high, 4)}"


def scale_words(data: ReportData) -> dict[str, Any] | None:
    """The legend of the view."""
    if data.scale is None or data.deviations is None:
        return None
    gradient, below, above = data.scale.css()
    marks = np.linspace(data.scale.low, data.scale.limit, 5)
    words = f"deviation [{data.unit}], + outside the part" if data.scale.signed else f"distance [{data.unit}]"
    if data.tolerance is not None:
        words += "; the scale ends at the tolerance, dark ends are out of it"
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
            "at": place_text(_rounded(place.position, data.size)),
            "goto": _goto(place.position - data.origin, data.size),
        }
        for place in data.worst
    ]


def regions_table(data: ReportData) -> dict[str, Any]:
    """Rows of the regions."""
    toleranced, unit = data.tolerance is not None, data.unit
    signed = data.deviations is not None and data.deviations.signed
    columns = [("Region", "", False), ("Points", "", True), ("Median", unit, True), ("Spread, 1σ", unit, True),
               ("95 % within", unit, True)]  # fmt: skip
    columns += [("In tolerance", "%", True), ("", "", False)] if toleranced else []
    columns += [("Middle x, y, z", unit, False), ("", "", False)]
    rows = [
        {
            "name": region.name,
            "points": f"{region.points:,}",
            "median": text_of(region.median, 2, sign=signed),
            "spread": text_of(region.spread, 2),
            "p95": text_of(region.within, 2),
            "within": None if region.bands is None else percent(region.bands.within),
            "passed": region.bands is not None and region.bands.passed,
            "at": place_text(_rounded(region.centre + data.origin, data.size)),
            "goto": _goto(region.centre, data.size),
        }
        for region in data.regions
    ]
    rule = f"A region passes where {100.0 * REQUIRED_SHARE:g} % of its points are within the tolerance."
    how = data.regions_how + (" The largest are shown." if len(rows) > 1 else "")
    return {"columns": columns, "rows": rows, "how": how, "rule": rule}


def _rounded(point: FloatArray, size: float) -> FloatArray:
    # To a ten-thousandth of the part: more digits say nothing of where a patch is.
    step = 10.0 ** np.floor(np.log10(size * 1e-4))
    rounded: FloatArray = np.round(point / step) * step
    return rounded


def _goto(centred: FloatArray, size: float) -> str:
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
