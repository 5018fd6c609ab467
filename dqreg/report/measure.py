"""What a report measures: where the scan lies, how far off the part it is, and the scale of the colours."""

from __future__ import annotations

import warnings

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.inspection import Deviations
from dqreg.report.colours import Scale, nice_above
from dqreg.report.result_protocol import RegisteredPair, RegistrationResult

# The scale of the colours reaches that share of the points on the part, at least the first and at most the second
# number of widths of the inliers: much clutter near the part must not wash out its colours.
SHOWN, LEAST, MOST = 0.98, 3.0, 12.0


def quiet_deviations(result: RegistrationResult, tolerance: float | None, reach: float | None = None) -> Deviations:
    """Deviations of a result; that they have no sign is said on the page, not as a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return result.deviations(tolerance, reach=reach)


def normals_at(deviations: Deviations, inputs: RegisteredPair) -> FloatArray:
    """Normal of the target at the closest place of each point."""
    geometry = inputs.target.geometry
    if isinstance(geometry, Mesh):
        return geometry.face_normals[deviations.faces]
    return np.zeros((len(deviations), 3))


def scale_of(deviations: Deviations, result: RegistrationResult) -> Scale:
    """Scale of the colours: the tolerance where one is given, else what shows nearly all points on the part."""
    if deviations.tolerance is not None:
        return Scale(deviations.tolerance, deviations.signed)
    sizes = np.abs(deviations.values[deviations.counted])
    width = float(result.settings.get("width") or 0.0)
    shown = float(np.quantile(sizes, SHOWN)) if len(sizes) else 0.0
    reach = min(max(LEAST * width, shown), MOST * width) if width > 0.0 else shown
    return Scale(nice_above(reach), deviations.signed)


def unit_of(result: RegistrationResult) -> str:
    """Length unit of the target, in words."""
    return str(result.settings.get("target_units") or "units of the target")
