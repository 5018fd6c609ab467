"""What a report shows, collected once: the page, the interactive view and the pictures all draw from it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose
from dqreg._numbers import is_number
from dqreg.errors import InputError
from dqreg.inspection import Decision, Deviations, Inspection, Place, Region, decide
from dqreg.inspection.decision.regions import cut_of, regions_of
from dqreg.inspection.tolerances import REQUIRED_SHARE
from dqreg.report.cameras import best_corner
from dqreg.report.colours import ByteArray, Scale, nice_above
from dqreg.report.result_protocol import RegisteredPair, RegistrationResult
from dqreg.report.sheet import Label, labels_of

# Worst places that are marked.
WORST_PLACES = 6


@dataclasses.dataclass(frozen=True, eq=False)
class ReportData:
    """A result with everything that is shown of it."""

    result: RegistrationResult  # The answer
    inputs: RegisteredPair  # Its two sides
    unit: str  # Length unit of the target, in words
    size: float  # Diagonal of the target's bounding box
    origin: FloatArray  # (3,): Middle of that box in the target's frame
    found: bool  # Whether there is a pose
    # (n, 3): The scan as it is drawn, about the origin: under the pose, or where it was before if there is none
    points: FloatArray
    T_before: FloatArray | None  # Pose before the registration, (4, 4); None where it is not known
    before_words: tuple[str, ...]  # What that pose is: its short name first
    tolerance: float | None  # Largest deviation allowed, target units
    # deviations, scale: Deviations and their colours; None where no pose was found
    deviations: Deviations | None
    scale: Scale | None
    worst: tuple[Place, ...]  # The worst first
    regions: tuple[Region, ...]  # The largest first
    regions_how: str  # How they were cut
    decision: Decision | None  # Whether the part is within its tolerance; None where none was given
    view: str  # Name of the view that shows most of the scan
    labels: tuple[Label, ...]  # Numbers on the part: characteristics of a plan, else worst places
    limits: tuple[float, float] | None = None  # Deviations allowed, signed, where all faces have the same

    def colour_codes(self, rows: Any) -> ByteArray:
        """Code of the colour of some points of the scan, by the tolerance of their faces; there must be deviations."""
        assert self.deviations is not None
        assert self.scale is not None
        allowed = self.deviations.allowed
        return self.scale.codes(self.deviations.values[rows], None if allowed is None else allowed.of(rows))

    @property
    def ellipsoid(self) -> FloatArray | None:
        """Semi-axes of one sigma of the middle of the part, (3, 3), one a row, target units; None where not known."""
        block = self.result.covariance[3:, 3:]
        if not np.isfinite(block).all():
            return None
        values, vectors = np.linalg.eigh(block)
        if values[-1] <= 0.0:
            return None
        axes: FloatArray = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        return axes


def collect(
    result: RegistrationResult,
    inputs: RegisteredPair,
    tolerance: float | None = None,
    T_start: ArrayLike | None = None,
    reach: float | None = None,
    deviations: Deviations | None = None,
    required_share: float = REQUIRED_SHARE,
    inspection: Inspection | None = None,
    decision: Decision | None = None,
) -> ReportData:
    """Everything that a report shows."""
    tolerance = checked_tolerance(tolerance)
    found = bool(np.isfinite(result.T_target_source).all())
    T_before, before_words = _before(result, T_start)
    surface = inputs.target.surface
    drawn = result.T_target_source if found else T_before
    if decision is None and inspection is not None and inspection.decision is not None:
        # A plan says what is asked, under its own alignment.
        decision, deviations = inspection.decision, inspection.deviations
    if decision is not None:
        tolerance = decision.tolerance
    if found and deviations is None:
        deviations = result._deviations(tolerance, reach=reach)
    regions: tuple[Region, ...] = ()
    how, view = "", "iso"
    if deviations is not None:
        view = best_corner(deviations.normals(np.flatnonzero(deviations.counted)))
        if tolerance is None:
            cut = cut_of(deviations)
            regions, how = regions_of(deviations, cut), cut.how
        else:
            decision = decision or decide(deviations, tolerance, required_share)
            regions, how = decision.regions, decision.regions_how
    origin, unit = inputs.target.origin, unit_of(result)
    worst = deviations.worst(WORST_PLACES) if deviations else ()
    return ReportData(
        result=result,
        inputs=inputs,
        unit=unit,
        size=surface.diagonal,
        origin=origin,
        found=found,
        points=deviations.points - origin if deviations else inputs.placed(np.eye(4) if drawn is None else drawn),
        T_before=T_before,
        before_words=before_words,
        tolerance=tolerance,
        deviations=deviations,
        scale=_scale_of(deviations, result) if deviations else None,
        worst=worst,
        regions=regions,
        regions_how=how,
        decision=decision,
        view=view,
        labels=labels_of(inspection, worst, unit),
        limits=None if decision is None or decision.own else (decision.low, decision.high),
    )


def checked_tolerance(tolerance: float | None) -> float | None:
    """A tolerance, or None.

    >>> checked_tolerance(0.1), checked_tolerance(None)
    (0.1, None)
    """
    if tolerance is None:
        return None
    if not is_number(tolerance):
        raise InputError(f"tolerance must be a length in the target's unit; got {tolerance!r:.60}")
    if not 0.0 < tolerance < np.inf:
        raise InputError(f"tolerance must be a length above 0, in the target's unit; got {tolerance!r}")
    return float(tolerance)


def _before(result: RegistrationResult, T_start: ArrayLike | None) -> tuple[FloatArray | None, tuple[str, ...]]:
    if T_start is None:
        T_start = result.settings.get("T_start")
    if T_start is not None:
        return as_pose(T_start, "T_start"), ("Before", "at the initial pose")
    if result.settings.get("start") != "given":
        return np.eye(4), ("Before", "as scanned")
    if result.history:
        return result.history[0].T_target_source, ("After the first step",)
    return None, ()


# The scale of the colours reaches that share of the points on the part, at least the first and at most the second
# number of widths of the inliers: much clutter near the part must not wash out its colours.
SHOWN_POINT_SHARE = 0.98
MIN_SCALE_WIDTHS, MAX_SCALE_WIDTHS = 3.0, 12.0


def _scale_of(deviations: Deviations, result: RegistrationResult) -> Scale:
    """Scale of the colours: the tolerance where one is given, else what shows nearly all points on the part."""
    if deviations.tolerance is not None:
        return Scale(deviations.tolerance, deviations.signed)
    sizes = np.abs(deviations.values[deviations.counted])
    width = float(result.settings.get("width") or 0.0)
    shown = float(np.quantile(sizes, SHOWN_POINT_SHARE)) if len(sizes) else 0.0
    reach = min(max(MIN_SCALE_WIDTHS * width, shown), MAX_SCALE_WIDTHS * width) if width > 0.0 else shown
    return Scale(nice_above(reach), deviations.signed)


def unit_of(result: RegistrationResult) -> str:
    """Length unit of the target; empty where it is not known."""
    return str(result.settings.get("target_units") or "")
