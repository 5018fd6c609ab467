"""A drift of the pose along a scan, fitted together with the motion that remains."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.solvers.motion_words import Vector
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.sandwich import scatter_of
from dqreg.trust.strain import known_before, robust_fit, weights_of

# Share of a drift that is the shift of the middle, where it has a direction.
MOSTLY = 0.5
# Of a drift along the scan: correspondences without which none is asked for; displacements, in sizes of the target, and
# standard deviations from which on it matters and is no chance. Scans in the order of lines or views bend along it too.
FEWEST_DRIFT, LEAST_DRIFT, SIGNIFICANT_DRIFT = 500, 0.003, 15.0


@dataclasses.dataclass(frozen=True)
class Drift:
    """How the pose changes from the first point of a scan to the last; zeros where nothing was fitted."""

    rotation_rad: float = 0.0
    displacement: float = 0.0  # Root mean square over the points, a length
    significance: float = 0.0  # Standard deviations
    along: Vector = (0.0, 0.0, 0.0)  # Direction in which the middle of the points moves, zeros where it mostly turns

    def matters(self, size: float) -> bool:
        """Whether it is significant, and not small against a size."""
        return self.significance >= SIGNIFICANT_DRIFT and self.displacement >= LEAST_DRIFT * size


def drift_of(points: FloatArray, normals: FloatArray, residuals: FloatArray, times: FloatArray) -> Drift:
    """Drift from distances along the target's normals, fitted together with the motion that remains.

    Shapes: points (n, 3) in the order of a space-filling curve, normals (n, 3), residuals (n,), times (n,) from -1/2 to
    1/2.
    """
    if len(residuals) < FEWEST_DRIFT:
        return Drift()
    middle = points.mean(axis=0)
    lever = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if not lever > 0.0:
        return Drift()
    still = plane_rows(points, normals, middle, lever)
    rows = np.vstack([still, times * still])
    fitted, weights = robust_fit(rows, residuals, lever, weights_of(residuals))
    left = residuals - fitted @ rows
    variance = float(weights @ left**2 / max(weights.sum() - len(rows), 1.0))
    known = known_before(product(rows * weights, rows.T), variance, lever)
    scatter = scatter_of(rows, points, normals, left, weights, known, variance)
    if scatter is None:
        return Drift()
    twist = fitted[6:]
    square = float(twist @ np.linalg.solve(scatter[6:, 6:] + np.eye(6) * 1e-12 * np.trace(scatter), twist))
    moved = np.cross(twist[:3] / lever, points - middle) + twist[3:]
    displacement = float(np.sqrt((moved**2).sum(axis=1).mean()))
    shift = float(np.linalg.norm(twist[3:]))
    x, y, z = (twist[3:] / shift if shift > MOSTLY * displacement else np.zeros(3)).tolist()
    return Drift(float(np.linalg.norm(twist[:3])) / lever, displacement, float(np.sqrt(max(square, 0.0))), (x, y, z))
