"""Covariance of a closed-form pose from the sums that gave it, without another look at the matches.

With x = R p' and y = q', the points about their means, the cost of a small rotation omega about the mean of the target
is ``E + omega^T K omega``, ``K = sum beta ((x . y) I - sym(x y^T)) + ... = tr(M) I - sym(M)`` with ``M = R^T``-turned
``H R^T``; that of a translation tau is ``sum beta |tau|^2``, and the two do not mix. So for weights 1 / variance the
covariance is ``diag(K^-1, I / sum beta)``. Sums of x . y and not of x . x: noise of both sides is in neither.

The smallest eigenvalue of K is ``(lambda_1 - lambda_2) / 2`` and its trace ``2 lambda_1``. Of narrow matches K has
lost the smallest one to rounding, and the gap, measured in better axes, puts it right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FitUncertainty:
    """What the covariance of one pose, or of b poses along a leading axis, follows from."""

    H: FloatArray  # (..., 3, 3): ``sum beta q' p'^T + sum alpha n m^T``
    weight: FloatArray | float  # (...,): ``sum beta``
    centre: FloatArray  # (..., 3): Weighted mean of the target points
    # (...,): Variance of a match of weight 1; NaN where no residual is left to estimate it from
    variance: FloatArray | float
    # (..., 3, 3): Covariance of the rotation for weights 1 / variance, where exact matches decide it and not H alone
    rotation: FloatArray | None = None

    def covariance(self, R: FloatArray, gap: FloatArray | float) -> FloatArray:
        """Covariance of the left increment about the centre. Shapes: R (..., 3, 3), returns (..., 6, 6)."""
        total = np.zeros((*R.shape[:-2], 6, 6))
        variance = np.asarray(self.variance)[..., None, None]
        rotation = rotation_covariance(self.H, R, gap) if self.rotation is None else self.rotation
        total[..., :3, :3] = variance * rotation
        total[..., 3:, 3:] = variance / np.asarray(self.weight)[..., None, None] * np.eye(3)
        return total


def rotation_covariance(H: FloatArray, R: FloatArray, gap: FloatArray | float) -> FloatArray:
    """Covariance of the rotation vector for weights 1 / variance. Shapes: H, R (..., 3, 3), returns (..., 3, 3)."""
    M = H @ np.swapaxes(R, -1, -2)
    trace = np.trace(M, axis1=-2, axis2=-1)[..., None, None]
    K = trace * np.eye(3) - 0.5 * (M + np.swapaxes(M, -1, -2))
    values, vectors = np.linalg.eigh(K)
    values[..., 0] = 0.5 * np.asarray(gap) * trace[..., 0, 0]
    covariance: FloatArray = (vectors / values[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return covariance


def residual_variance(cost: FloatArray | float, points: int, directions: int, parameters: int = 6) -> float:
    """Variance of a match of weight 1 from the residuals: three of a point, two of a direction."""
    left = 3 * points + 2 * directions - parameters
    return float(cost) / left if left > 0 else np.nan


def counted(weights: FloatArray | None, rows: int) -> int:
    """Matches that carry weight."""
    return rows if weights is None else int(np.count_nonzero(weights))
