"""The answer in a few lines: verdict, pose, how exact, and what was used."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqreg.report.hints import hints_of, remarks_of
from dqreg.report.text import unit_words
from dqreg.trust.free_space import MAX_HIDDEN_SHARE

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.report.result_protocol import RegistrationResult

COLOURS = {"accepted": "green", "suspect": "yellow", "failed": "red"}
# What a verdict says of the alignment: "accepted" alone could be taken for the part.
ALIGNMENT = {"accepted": "trusted", "suspect": "doubtful", "failed": "failed"}
# Where the unit is not known, it is asked for once.
UNNAMED = "the target's unit: name it with --target-units"


def summary_rows(result: RegistrationResult) -> list[tuple[str, str]]:
    """Names and values of the summary, without the verdict."""
    settings = result.settings
    unit = unit_words(settings["target_units"])
    rows = [
        ("status", f"{result.status} after {len(result.history)} iterations, {result.timings['total']:.2f} s"),
        (
            "source",
            f"{settings['source_points']} points, {settings['used_points']} used, {settings['source_dropped']} "
            f"dropped; spacing {settings['source_spacing']:.4g}{unit}, noise {settings['source_noise']:.4g}{unit}",
        ),
        (
            "target",
            f"{settings['target_kind']}, size {settings['diagonal']:.5g}{unit}; "
            f"correspondences up to {settings['max_distance']:.4g}{unit}",
        ),
    ]
    if words := confidence_words(result):
        rows.insert(0, ("confidence", words))
    if words := scale_words(result):
        rows.append(("scale", words))
    elif settings["source_scale"] != 1.0:
        rows.append(("units", f"source converted from {settings['source_units']}: x {settings['source_scale']:g}"))
    if words := viewpoint_words(result):
        rows.append(("viewpoint", words))
    if np.isfinite(result.rms):
        rows.append(
            (
                "inliers",
                # Those of the verdict are a share of the points near the target.
                f"{100 * result.inlier_fraction:.1f} % of the points used, those far off the target too; rms distance "
                f"of the inliers {result.rms:.4g}{unit}",
            )
        )
        rows.append(("weakest", weakest_words(result)))
    return rows


def weakest_words(result: RegistrationResult) -> str:
    """The motion that is constrained least, and what one sigma of it does."""
    if not result.observability:
        return "none: all degrees of freedom are locked"
    weakest, settings = result.observability[0], result.settings
    noun = "part" if settings["target_kind"] == "mesh" else "scan"
    length = f"{weakest.sigma:.2g}{unit_words(settings['target_units']) or ' in the unit of the target'}"
    known = f"one sigma displaces the {noun} by up to {length}" if np.isfinite(weakest.sigma) else "no sigma is known"
    return f"{weakest.words} ({known})"


def confidence_words(result: RegistrationResult) -> str:
    """How probable it is that the pose is right; empty where that is not known."""
    confidence = result.verdict.confidence
    if not np.isfinite(confidence):
        return ""
    # A fit to some hundred tasks knows no more than this.
    shown = f"{100.0 * confidence:.0f}" if 0.01 < confidence < 0.99 else ("above 99" if confidence > 0.5 else "below 1")
    return f"the pose is right with a probability of {shown} %"


def scale_words(result: RegistrationResult) -> str:
    """What the source was multiplied with because it was asked for; units are another matter."""
    settings, scale, sigma = result.settings, result.scale, result.scale_sigma
    if settings.get("scale_solved"):
        known = f"± {sigma:.2g} (one sigma)" if np.isfinite(sigma) else "is not fixed by the data"
        return f"solved for: source x {scale:.9g} {known}"
    return "" if settings.get("scale", 1.0) == 1.0 else f"as asked, units included: source x {scale:.9g}"


def viewpoint_words(result: RegistrationResult) -> str:
    """The viewpoint that the scan brought along, or what it says against the one given; empty where neither."""
    if (place := result.settings.get("source_viewpoint")) is not None:
        return f"({', '.join(f'{x:.7g}' for x in np.round(place, 12) + 0.0)}), as the scan itself says"
    share = result.settings.get("viewpoint_behind", 0.0)
    if not share > MAX_HIDDEN_SHARE:
        return ""
    return (
        f"not where the scanner stood: from there {100 * share:.0f} % of the scan's own points are behind others. It "
        "is asked for in the coordinates and units of the scan; where it stood in several places, give them all"
    )


def print_summary(console: Console, result: RegistrationResult) -> None:
    """Print the verdict, the rows and the pose."""
    level = result.verdict.level
    unit = result.settings["target_units"]
    console.print(
        f"[bold {COLOURS[level]}]{level.upper()}[/]: alignment {ALIGNMENT[level]} "
        f"[dim](lengths in {unit or UNNAMED})[/]",
        highlight=False,
        soft_wrap=True,
    )
    for reason in (*result.verdict.reasons, *remarks_of(result)):
        console.print(f"  {reason}", highlight=False, markup=False, soft_wrap=True)
    for name, value in summary_rows(result):
        console.print(f"{name:>10}  {value}", highlight=False, markup=False, soft_wrap=True)
    for hint in hints_of(result):
        console.print(f"{'try':>10}  {hint}", highlight=False, markup=False, soft_wrap=True)
    if np.isfinite(result.rms):
        console.print("T_target_source" + (f" (translation in {unit})" if unit else ""), highlight=False, markup=False)
        for row in result.T_target_source:
            console.print("  " + " ".join(f"{x: .12e}" for x in row), highlight=False, soft_wrap=True)
