"""What a report says of the run itself: uncertainty, the two sides, settings, iterations, versions."""

from __future__ import annotations

import importlib.metadata
import platform
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.report.result_protocol import RegistrationResult
from dqreg.report.summary import scale_words, viewpoint_words
from dqreg.report.text import percent, place_text, setting_text, text_of, unit_words
from dqreg.trust.records import Check

Rows = list[tuple[str, str]]


def facts_of(result: RegistrationResult, unit: str) -> dict[str, Any]:
    """What the page's template asks for, by name."""
    found = bool(np.isfinite(result.T_target_source).all())
    values = {**result.settings, **{name: file_name(result.settings.get(name)) for name in ("source", "target")}}
    # The steps of a plan's alignment stand in a table of their own.
    shown = sorted((name, value) for name, value in values.items() if name != "alignments")
    settings = [(name, setting_text(name, value, unit)) for name, value in shown]
    middle = -(-len(settings) // 2)
    return {
        "motions": motions_of(result),
        "checks": checks_of(result),
        "sigmas": _sigmas(result, unit) if found else None,
        "converted": _converted(result),
        "history": _history(result, unit),
        "sides": _sides(result, unit),
        "settings": [settings[:middle], settings[middle:]],
        "timings": [(name, f"{value:.3f}") for name, value in result.timings.items()],
        "versions": versions_of(),
    }


def file_name(value: Any) -> str:
    """Name of a file without its folders, which are nobody's but the writer's.

    >>> file_name("/home/me/scan.ply"), file_name(None)
    ('scan.ply', 'not known')
    """
    return Path(str(value)).name or "not known" if value else "not known"


def checks_of(result: RegistrationResult) -> list[dict[str, str]]:
    """Rows of the questions that the verdict asked: the ones against the pose first, the ones not asked last."""
    order = sorted(result.verdict.checks, key=lambda check: (check.passed is not False, bool(np.isnan(check.value))))
    return [
        {
            # Files of old say that a question passed which was not asked.
            "sign": "✗" if check.passed is False else "✓" if np.isfinite(check.value) or _is_yes(check) else "–",
            "level": "suspect" if check.passed is False else "accepted",
            "question": check.question,
            "value": "" if _is_yes(check) else _figure(check.value, check.unit),
            "limit": f"{check.relation} {_figure(check.limit, check.unit)}"
            if np.isfinite(check.limit) and not _is_yes(check)
            else "",
            "code": check.code,
        }
        for check in order
    ]


def _is_yes(check: Check) -> bool:
    """Whether a question is answered by yes or no: it has neither a figure nor a unit."""
    return not check.unit and not check.limit


def _figure(value: float, unit: str) -> str:
    if not np.isfinite(value):
        return "not asked"
    # Two digits, and 100 % is no power of ten.
    shares = f"{100.0 * value:.0f}" if value >= 0.1 else text_of(100.0 * value, 2)
    # A share, which a file of old has in "%" likewise.
    return f"{shares} %" if unit in ("1", "%") else f"{text_of(value, 3)} {unit}".strip()


def motions_of(result: RegistrationResult) -> list[dict[str, str]]:
    """Rows of the six motions."""
    return [
        {
            "words": direction.words,
            "percent": f"{100.0 * min(max(direction.strength, 0.0), 1.0):.0f}",
            "strength": text_of(direction.strength, 2),
            "sigma": text_of(direction.sigma, 2) if np.isfinite(direction.sigma) else "unconstrained",
        }
        for direction in result.observability
    ]


def _sigmas(result: RegistrationResult, unit: str) -> dict[str, Any]:
    """Standard deviations of the six numbers of the pose: columns, one row, and what they mean."""
    sigma = np.sqrt(np.diag(result.covariance))
    row = [text_of(s, 2) if np.isfinite(s) else "unconstrained" for s in [*np.rad2deg(sigma[:3]), *sigma[3:]]]
    columns = [(f"rotation about {axis}", "degrees", True) for axis in "xyz"]
    columns += [(f"translation along {axis}", unit, True) for axis in "xyz"]
    words = (
        f"One sigma, with the target's axes, about its centre {place_text(np.array(result.settings['centre']))}. "
        "Estimated from how the residuals scatter from patch to patch of the surface; where correspondences are too "
        "few for that, as if all were independent. Errors common to the whole scan, such as calibration, are not "
        "included."
    )
    return {"columns": columns, "row": row, "words": words}


def _sides(result: RegistrationResult, unit: str) -> Rows:
    """What was registered to what."""
    get = result.settings.get
    rows = [
        ("Scan", file_name(get("source"))),
        ("Scan points", f"{get('source_points', 0):,}, of which {get('used_points', 0):,} were used"),
        ("Dropped", f"{get('source_dropped', 0):,} points that were not finite, or far from all others"),
        ("Spacing of the scan", f"{text_of(get('source_spacing'))}{unit_words(unit)}"),
        ("Noise of the scan", f"{text_of(get('source_noise'))}{unit_words(unit)}, one sigma, estimated"),
        ("Target", f"{file_name(get('target'))} ({get('target_kind', 'not known')})"),
        ("Size of the target", f"{text_of(get('diagonal'), 5)}{unit_words(unit)}, diagonal of its bounding box"),
    ]
    if words := viewpoint_words(result):
        rows.append(("Viewpoint", words))
    converted = _converted(result)
    return [*rows, ("Units", converted)] if converted else rows


def _converted(result: RegistrationResult) -> str:
    """What was done to the scan's unit; empty if nothing."""
    scaled = scale_words(result)
    if scaled:
        return f"Scale {scaled}."
    if result.scale == 1.0:
        return ""
    names = (result.settings.get("source_units"), result.settings.get("target_units"))
    return f"The scan's coordinates were multiplied by {result.scale:g} first ({names[0]} to {names[1]})."


def _history(result: RegistrationResult, unit: str) -> dict[str, Any]:
    """All iterations: columns and rows."""
    units = {"No.": "", "Stage": "", "Points": "", "Inliers": "%", "Rms": unit, "Kernel scale": unit,
             "Rotation": "degrees", "Step": "diagonals"}  # fmt: skip
    columns = [(name, of, True) for name, of in units.items()]
    rows = [
        (
            str(record.number),
            record.stage,
            f"{record.points:,}",
            percent(record.inlier_fraction),
            text_of(record.rms),
            text_of(record.kernel_scale),
            text_of(float(np.rad2deg(record.turn_rad)), 2),
            "rejected" if np.isinf(record.motion) else text_of(record.motion, 2),
        )
        for record in result.history
    ]
    return {"columns": columns, "rows": rows}


def versions_of() -> dict[str, str]:
    """Versions of what did the work.

    >>> "numpy" in versions_of()
    True
    """
    found = {"dqreg": importlib.metadata.version("dqreg"), "Python": platform.python_version()}
    for name in ("numpy", "scipy", "open3d", "open3d-cpu"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found | {"Machine": f"{platform.system()} {platform.machine()}"}
