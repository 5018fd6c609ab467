"""What a report says of the scan on the part: figures, deviations, regions; plain values for the template."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection import Band, Counts, Decision
from dqreg.report.charts import NARROW, WIDE, histogram
from dqreg.report.report_data import ReportData
from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.text import percent, place_text, text_of

ADVICE = {
    "accepted": "The pose can be used.",
    "suspect": "Look at the reasons before the pose is used.",
    "failed": "No pose was found; there is nothing to use.",
}
SIGNS = {"accepted": "✓", "suspect": "!", "failed": "✗"}
OUTCOME_SIGNS = {"pass": "✓", "undecided": "?", "fail": "✗"}
# Rows of the table of regions.
ROWS = 14


def tiles_of(result: RegistrationResult, data: ReportData | None, unit: str) -> list[tuple[str, str, str]]:
    """The few numbers that matter most: name, value, remark."""
    if not np.isfinite(result.rms):
        return []
    settings = result.settings
    tiles: list[tuple[str, str, str]] = []
    if data is not None and data.deviations is not None:
        summary = data.deviations.summary()
        total = summary.count + summary.beyond
        tiles.append(("Root mean square", f"{text_of(summary.rms)} {unit}", "deviation of the points on the part"))
        tiles.append(("95 % of them within", f"{text_of(summary.p95)} {unit}", "absolute deviation"))
        tiles.append(("On the part", f"{percent(summary.count / total)} %", f"{summary.count:,} of {total:,} points"))
        if data.decision is not None:
            words = f"of the points on the part; {percent(data.decision.required_share)} % are required"
            within = f"Within ±{text_of(data.decision.tolerance)} {unit}"
            tiles.insert(0, (within, f"{percent(data.decision.share_within)} %", words))
    else:
        tiles.append(("Scan to target, rms", f"{text_of(result.rms)} {unit}", "distance of the inliers"))
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
        "counts": counts_rows(found.counts, found.reach, unit),
        "bands": _bands(data) if data.tolerance is not None else None,
    }


def counts_rows(counts: Counts, reach: float, unit: str) -> list[tuple[str, str, str]]:
    """What the points of the scan belong to: name, number, remark; the numbers add up."""
    rows = [
        ("Points of the scan", counts.total, ""),
        ("Beyond reach", -counts.beyond_reach, f"farther than {text_of(reach, 4)} {unit} from the part"),
        ("Other surfaces", -counts.other_surfaces, "within reach, but they run on beyond it: a table, a clamp"),
        ("Outliers", -counts.outliers, "single points off every surface"),
        ("Excluded", -counts.excluded, "in a box that was left out"),
        ("On the part", counts.on_part, "all figures are of these"),
    ]
    return [
        (name, f"{number:,}".replace("-", "− "), words)
        for name, number, words in rows
        if number or name in ("Points of the scan", "On the part")
    ]


def decision_of(data: ReportData) -> dict[str, Any] | None:
    """The line on the part, and why."""
    if data.decision is None:
        return None
    found = data.decision
    return {
        "outcome": found.outcome,
        "sign": OUTCOME_SIGNS[found.outcome],
        "tolerance": text_of(found.tolerance, 6),
        "words": decision_words(found, data.unit, data.deviations is not None and data.deviations.signed),
    }


def decision_words(found: Decision, unit: str, signed: bool) -> list[str]:
    """Why a part passes, fails or stays undecided: one sentence a cause."""
    share = f"{percent(found.share_within)} % of the points on the part are within ±{text_of(found.tolerance)} {unit}"
    words = [f"{share}; {percent(found.required_share)} % are required."]
    out = [place for place in found.places if place.outcome == "fail"]
    open_places = [place for place in found.places if place.outcome == "undecided"]
    if out:
        worst = text_of(out[0].value, sign=signed)
        room = text_of(out[0].uncertainty, 2)
        many = "1 place is" if len(out) == 1 else f"{len(out)} places are"
        words.append(f"{many} out of tolerance; the worst deviates by {worst} ± {room} {unit} (k = 2).")
    if open_places:
        many = "1 place is" if len(open_places) == 1 else f"{len(open_places)} places are"
        words.append(f"{many} within the uncertainty of the tolerance (k = 2): neither in nor out is proven.")
    bad = [region for region in found.regions if region.outcome == "fail"]
    if bad:
        many = "1 region fails" if len(bad) == 1 else f"{len(bad)} of {len(found.regions)} regions fail"
        words.append(f"{many}; see the table of regions.")
    words.append(
        f"The pose adds an uncertainty of up to {text_of(found.uncertainty, 2)} {unit} (k = 2) to a deviation."
    )
    return words


def _bands(data: ReportData) -> dict[str, Any]:
    assert data.deviations is not None
    bands = data.deviations.bands()
    rows = [
        {
            "range": _range(band),
            "count": f"{band.count:,}",
            "share": percent(band.share),
            "inside": max(abs(band.low), abs(band.high)) <= bands.tolerance,
        }
        for band in bands.rows
    ]
    return {"tolerance": text_of(bands.tolerance, 6), "rows": rows}


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
    columns += [("In tolerance", "%", True), ("Decision", "", False)] if toleranced else []
    columns += [("Middle x, y, z", unit, False), ("", "", False)]
    # Those that do not pass must be seen.
    shown = sorted(data.regions, key=lambda region: ("fail", "undecided", "pass", None).index(region.outcome))[:ROWS]
    rows = [
        {
            "name": region.name,
            "points": f"{region.points:,}",
            "median": text_of(region.median, 2, sign=signed),
            "spread": text_of(region.spread, 2),
            "p95": text_of(region.within, 2),
            "within": None if region.share_within is None else percent(region.share_within),
            "outcome": region.outcome,
            "sign": OUTCOME_SIGNS[region.outcome] if region.outcome else "",
            "at": place_text(_rounded(region.centre + data.origin, data.size)),
            "goto": _goto(region.centre, data.size),
        }
        for region in shown
    ]
    rule = ""
    if data.decision is not None:
        required = percent(data.decision.required_share)
        rule = f"A region passes where {required} % of its points and each place of it are within the tolerance."
    how = data.regions_how
    if len(shown) < len(data.regions):
        how += f" {len(shown)} of {len(data.regions)} are shown: those that do not pass, then the largest."
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
