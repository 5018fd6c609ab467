"""The decision on the deviations for the page: in words, by bands of deviation, by regions."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg.inspection import Band, Decision
from dqreg.inspection.decision.decision import SOLVED_SCALE
from dqreg.inspection.decision.places import MEDIAN_SIGMA, PLACE_POINTS
from dqreg.report.decision_rows import OUTCOME_SIGNS, SCALE_WORDS, shown_outcome, wall_words
from dqreg.report.page_tables import goto, rounded
from dqreg.report.report_data import ReportData
from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.text import (
    decimals_of,
    fixed,
    limits_text,
    percent,
    percent_asked,
    place_text,
    text_of,
    tolerance_text,
    unit_words,
)

# Rows of the table of regions.
MAX_REGION_ROWS = 14


def decision_of(data: ReportData, *, trusted: bool) -> dict[str, Any] | None:
    """The line on the part, and why."""
    if data.decision is None:
        return None
    found = data.decision
    return {
        **shown_outcome(found.outcome, trusted=trusted),
        "against": tolerance_text(found, data.unit),
        "words": decision_words(
            found,
            data.unit,
            data.deviations is not None and data.deviations.signed,
            None if data.deviations is None else data.deviations.noise,
        ),
    }


def decision_words(found: Decision, unit: str, signed: bool, noise: float | None = None) -> list[str]:
    """Why a part passes, fails or stays undecided: one sentence a cause; ``noise`` is that of the scan."""
    of = unit_words(unit)
    against = tolerance_text(found, unit)
    share = f"{percent(found.share_within)} % of the points on the part are within {against}"
    words = [f"{share}; {percent_asked(found.required_share)} % are required."]
    words += _noise_words(found, noise or 0.0, of)
    if not np.isnan(found.scanned):
        rest = "" if found.scanned == 1.0 else "; of the rest nothing is decided"
        words.append(f"{percent(found.scanned)} % of the part's surface was scanned{rest}.")
    out = [place for place in found.places if place.outcome == "fail"]
    open_places = [place for place in found.places if place.outcome == "undecided"]
    if out:
        worst = text_of(out[0].value, sign=signed)
        room = text_of(out[0].uncertainty, 2)
        many = "1 place is" if len(out) == 1 else f"{len(out)} places are"
        median = f"the median of {PLACE_POINTS} neighbouring points deviates by {worst} ± {room}{of} (k = 2)"
        words.append(f"{many} out of tolerance; at the worst {median}.")
    if open_places:
        many = "1 place is" if len(open_places) == 1 else f"{len(open_places)} places are"
        words.append(f"{many} within the uncertainty of the tolerance (k = 2): neither in nor out is proven.")
    bad = [region for region in found.regions if region.outcome == "fail"]
    if bad:
        many = "1 region fails" if len(bad) == 1 else f"{len(bad)} of {len(found.regions)} regions fail"
        words.append(f"{many}; see the table of regions.")
    unproven = sum(region.outcome == "undecided" for region in found.regions)
    if unproven:
        many = "1 region is" if unproven == 1 else f"{unproven} of {len(found.regions)} regions are"
        words.append(f"{many} undecided: what the pose and the noise of points leave open allows pass and fail.")
    if found.wall_doubts:
        words.append(f"The sides of a thin wall cannot be told apart: {wall_words(found, of)} (wall_side).")
    if SOLVED_SCALE in found.codes:
        words.append(SCALE_WORDS)
    words.append(f"The pose adds an uncertainty of up to {text_of(found.uncertainty, 2)}{of} (k = 2) to a deviation.")
    return words


def _noise_words(found: Decision, noise: float, of: str) -> list[str]:
    """Where a part without any deviation would have too few points within its tolerance as well."""
    from scipy.special import ndtr

    if noise == 0.0 or found.share == "pass" or np.isinf(found.high):
        return []
    share = float(ndtr(found.high / noise) - ndtr(found.low / noise))
    if share >= found.required_share:
        return []
    words = f"Noise of {text_of(noise, 2)}{of} alone leaves {percent(share)} % of the points of a perfect part within"
    if found.share == "fail":
        return [f"{words}; more are out than that explains."]
    return [f"{words}: the scan is too noisy to pass a part at this tolerance, and proves no fault either."]


def shape_words(result: RegistrationResult) -> str:
    """Beside an outcome: that a scale was solved for, so that the part may be of another size; "" where none was."""
    if not result.settings.get("scale_solved"):
        return ""
    return f", in shape alone (the scan was scaled by {result.scale:.6g} to fit)"


def bands_of(data: ReportData) -> dict[str, Any] | None:
    """Points by their deviation, in steps of the tolerance; None where there is not one, equal on both sides."""
    if data.deviations is None or data.limits is None or data.limits[0] != -data.limits[1]:
        return None
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


def _decimals(data: ReportData) -> tuple[int, int]:
    """Decimals of the medians and of the spreads of all regions: down to the second digit of what is usual there."""
    spreads = np.array([region.spread for region in data.regions] or [0.0])
    counts = np.array([region.points for region in data.regions] or [1])
    usual = float(np.median(spreads))
    return decimals_of(float(np.median(MEDIAN_SIGMA * spreads / np.sqrt(counts)))), decimals_of(usual)


def regions_table(data: ReportData) -> dict[str, Any]:
    """Rows of the regions."""
    toleranced, unit = data.tolerance is not None, data.unit
    signed = data.deviations is not None and data.deviations.signed
    columns = [("No.", "", True), ("Region", "", False), ("Points", "", True), ("Median", unit, True),
               ("Spread, 1σ", unit, True), ("95 % within", unit, True)]  # fmt: skip
    columns += [("Tolerance", unit, True), ("In tolerance", "%", True), ("Decision", "", False)] if toleranced else []
    columns += [("Middle x, y, z", unit, False), ("", "", False)]
    # Those that do not pass must be seen.
    order = ("fail", "undecided", "pass", None)
    shown = sorted(data.regions, key=lambda region: order.index(region.outcome))[:MAX_REGION_ROWS]
    of_median, of_spread = _decimals(data)
    rows = [
        {
            "number": str(region.number),
            "name": region.name,
            "points": f"{region.points:,}",
            "median": fixed(region.median, of_median, sign=signed),
            "spread": fixed(region.spread, of_spread),
            "p95": fixed(region.within, of_spread),
            "tolerance": limits_text(region.low, region.high) if toleranced else None,
            "within": "" if region.share_within is None else percent(region.share_within),
            "outcome": region.outcome or "",
            "sign": OUTCOME_SIGNS[region.outcome] if region.outcome else "",
            "at": place_text(rounded(region.centre + data.origin, data.size)),
            "goto": goto(region.centre, data.size),
        }
        for region in shown
    ]
    rule = ""
    if data.decision is not None:
        required = percent_asked(data.decision.required_share)
        rule = f"A region passes where {required} % of its points and each place of it are within its tolerance."
    how = data.regions_how
    if len(shown) < len(data.regions):
        how += f" {len(shown)} of {len(data.regions)} are shown: those that do not pass, then the largest."
    return {"columns": columns, "rows": rows, "how": how, "rule": rule}
