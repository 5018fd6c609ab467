"""One point-to-plane step of scale and pose together, for closest points on a surface; only where it is asked for.

Points may slide along the faces of the target, so the closed form for given matches (Horn 1987, section 2.E) converges
slowly here, and its least-squares form shrinks the source to nothing in the end. Seven unknowns on the tangent planes,
a twist and the logarithm of the scale, are solved at once instead.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.solvers.sandwich import MIN_PATCHES, PATCH_COUNT

# Share of the scale's own information that must be left once the pose is free: of a flat or round part nothing is.
MIN_HELD_SHARE = 1e-8


@dataclasses.dataclass(frozen=True)
class SurfaceMatches:
    """A scaled source under a pose, and where it meets the target."""

    points: FloatArray  # (n, 3): Points of the scaled source under the pose, in the target's frame
    # closest, normals: (n, 3): Closest places of the target and its unit normals there, of any sign; a zero normal
    # leaves its match out
    closest: FloatArray
    normals: FloatArray
    weights: FloatArray  # (n,): beta >= 0, best of a kernel that the whole scan passes: see `GemanMcClure.of_median`


@dataclasses.dataclass(frozen=True)
class ScaleStep:
    """A small change of scale and pose together.

    The points go to ``middle + shift + factor Rot(turn) (p - middle)``.
    """

    factor: float  # What the scale is multiplied with
    # Standard deviation of the logarithm of the scale, with the pose free: of its residuals as they scatter from patch
    # to patch where there are enough of them, and never less than if all were independent
    sigma: float
    turn: FloatArray  # (3,): Rotation vector
    shift: FloatArray  # (3,): A length vector
    middle: FloatArray  # (3,): Weighted mean of the points
    pull: FloatArray  # (6,): Derivative of rotation and translation by the logarithm of the scale, cost kept least

    def moved(self, T_target_source: FloatArray) -> FloatArray:
        """Pose of the source scaled by the factor too."""
        turn = twist.exp(np.r_[self.turn, 0.0, 0.0, 0.0])[:3, :3]
        away = T_target_source[:3, 3] - self.middle
        return pose.from_parts(turn @ T_target_source[:3, :3], self.middle + self.shift + self.factor * (turn @ away))

    def follow(self, T_target_source: FloatArray, centre: FloatArray) -> FloatArray:
        """How the pose of the scaled source follows the logarithm of the scale. Shapes: returns (6,)."""
        turn, shift = self.pull[:3], self.pull[3:]
        followed: FloatArray = np.r_[
            turn, shift + np.cross(turn, centre - self.middle) + T_target_source[:3, 3] - self.middle
        ]
        return followed


def scale_step(matches: SurfaceMatches, *, hold: bool = False) -> ScaleStep:
    """Scale and motion that put a source on the tangent planes of its matches.

    Minimises ``sum beta (n.(p + w x p' + v + s q' - q))^2`` over the twist (w, v) and s together, with p' and q' from
    the weighted mean of the points; the factor is ``exp(s)``.
    """
    used = (matches.weights > 0.0) & matches.normals.any(axis=1)
    count = int(np.count_nonzero(used))
    if count < 8:
        raise DegenerateGeometryError(f"{count} matches are too few for a scale and a pose; at least 8 are needed")
    p, n, weights = matches.points[used], matches.normals[used], matches.weights[used]
    middle = weights @ p / weights.sum()
    # Lengths in sizes of the source, so that all seven columns are alike.
    size = _spread_of(p, weights)
    away, met = (p - middle) / size, (matches.closest[used] - middle) / size
    # The scale moves the places on the target: a point is off by its noise, which is in its gap too, so that each
    # square of it would ask for a smaller source (errors in variables).
    rows = np.column_stack([np.cross(away, n), n, np.einsum("ij,ij->i", n, met)])
    gaps = -np.einsum("ij,ij->i", n, p - matches.closest[used]) / size
    weighed = weights[:, None] * rows
    form, right = rows.T @ weighed, weighed.T @ gaps
    # What the pose could explain is taken out of the scale's column; unconstrained motions do not matter.
    inverse = np.linalg.pinv(form[:6, :6], rcond=1e-10, hermitian=True)
    pull = -inverse @ form[:6, 6]
    held = float(form[6, 6] + form[6, :6] @ pull)
    if not hold and not held > MIN_HELD_SHARE * weights.sum():
        raise DegenerateGeometryError(
            "the matches leave the scale free (a plane or a cone fits itself at any size); give the scale, or scan "
            "opposite sides of the part"
        )
    log = 0.0 if hold else float(right[6] + pull @ right[:6]) / held
    motion = inverse @ right[:6] + log * pull
    residuals = gaps - rows @ np.append(motion, log)
    alone = rows[:, 6] + rows[:, :6] @ pull
    lengths = scaling_by(1.0, size)
    return ScaleStep(
        math.exp(log),
        math.nan if hold else _sigma(alone, residuals, weights, held),
        motion[:3],
        size * motion[3:],
        middle,
        lengths * pull,
    )


def _spread_of(points: FloatArray, weights: FloatArray) -> float:
    """Weighted root mean square distance of points from their mean; 0 where no point carries weight."""
    total = weights.sum()
    if not total > 0.0:
        return 0.0
    away = points - weights @ points / total
    return math.sqrt(dot(weights, np.einsum("ij,ij->i", away, away)) / total)


def _sigma(alone: FloatArray, residuals: FloatArray, weights: FloatArray, held: float) -> float:
    # As in the covariance of the pose: White's sandwich over patches, for the one column that is left of the scale.
    total = max(float(weights.sum()) - 7.0, 1.0)
    independent = math.sqrt(dot(weights, residuals**2) / total / held)
    count = min(PATCH_COUNT, len(weights) // 8)
    if count < MIN_PATCHES:
        return independent
    starts = np.linspace(0, len(weights), count, endpoint=False).astype(np.int64)
    scores = np.add.reduceat(alone * weights * residuals, starts)
    return max(independent, math.sqrt(float(scores @ scores) * count / (count - 8.0)) / held)
