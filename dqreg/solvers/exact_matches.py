"""Exact matches, those of infinite weight: they are met first, and what they leave open is fitted to the others.

An exact point is an origin on either side: about it all other points are directions of their lengths, and further exact
points are exact directions. So the pose is a rotation beside exact directions and, where no point is exact, the
translation of the means. One exact direction, or several that are parallel, leaves a rotation about it, which follows
from the sums across it in closed form (`narrow.rotation_of`); two that are not parallel leave nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, as_float
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import quaternion
from dqreg.solvers.closed_form import Why, best_rotation, require_determined
from dqreg.solvers.exact_cost import cost_of_pose
from dqreg.solvers.fit import Fit
from dqreg.solvers.matches import Matches, refuse_bad_values, weights_of
from dqreg.solvers.moments import sums_of
from dqreg.solvers.narrow_data import Aligned, is_narrow, long_axes, products_in_axes, rotation_of
from dqreg.solvers.rounding import SAME_POINT, SMALLEST_GAP, grain_of
from dqreg.solvers.uncertainty import FitUncertainty, counted, residual_variance, rotation_covariance
from dqreg.solvers.undetermined_rotation import no_weight_message, undetermined

Pair = tuple[FloatArray, FloatArray]

# Exact matches agree to this part of their extent, or in radians: typed coordinates do, measured ones do not.
EXACT_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RotationBeside:
    """The rotation that meets exact directions and fits the others."""

    R: FloatArray  # (3, 3)
    gap: float  # As `RotationFit.eigenvalue_gap`
    covariance: FloatArray  # (3, 3): For weights 1 / variance
    free: int  # Rotations that the exact directions leave to the others: 0, 1 or 3


def split_weights(weights: ArrayLike | None, name: str) -> tuple[ArrayLike | None, BoolArray | None]:
    """The weights with zeros for infinite ones, and where these are; None where there are none."""
    if weights is None:
        return None, None
    given = as_float(weights, name)
    exact = given == np.inf
    return (np.where(exact, 0.0, given), exact) if exact.any() else (weights, None)


def require_squares(weights: FloatArray, *sides: FloatArray) -> None:
    """Raise if a weighted square leaves float64."""
    with np.errstate(over="ignore"):
        largest = max(1.0, float(weights.max(initial=0.0))) * max(float((side * side).sum()) for side in sides)
    if not math.isfinite(largest):
        raise InputError("the matches are finite, but their weighted squares are not; give directions in unit length")


def rotation_beside(
    exact: Pair, others: Matches, grains: FloatArray | None = None, least_angle: float = 0.0
) -> RotationBeside:
    """Rotation that meets exact directions (n, 3), as well as can be, and fits others, whose points are about zero.

    The grains (2,) are how far rounding may have moved these points, and exact directions are known to
    ``least_angle``: within it of each other they count as parallel.
    """
    none = np.zeros((0, 3))
    if len(exact[0]):
        matches = Matches(none, none, *exact)
        held = sums_of(matches)
        try:
            r, _, gap, _ = best_rotation(held, matches)
            if gap > least_angle**2:
                return RotationBeside(quaternion.to_matrix(r), math.inf, np.zeros((3, 3)), 0)
        except DegenerateGeometryError:
            if not is_narrow(held.direction_cross):
                raise
        return _about_axis(long_axes(held.direction_cross), others, grains, least_angle)
    m = others
    rows = np.vstack([m.points_source, m.directions_source]), np.vstack([m.points_target, m.directions_target])
    beta, alpha = weights_of(m)
    matches = Matches(none, none, *rows, None, np.concatenate([beta, alpha]))
    r, _, gap, H = best_rotation(sums_of(matches), matches)
    R = quaternion.to_matrix(r)
    return RotationBeside(R, gap, rotation_covariance(H, R, gap), 3)


def _about_axis(axes: Pair, others: Matches, grains: FloatArray | None, least_angle: float) -> RotationBeside:
    m, nowhere = others, (np.zeros(3), np.zeros(3))
    held = Aligned(
        *axes,
        products_in_axes((m.points_source, m.points_target), m.point_weights, nowhere, axes),
        products_in_axes((m.directions_source, m.directions_target), m.direction_weights, nowhere, axes),
        np.zeros(2) if grains is None else grains,
    )
    R, lambda_1, gap = rotation_of(held.points + held.directions, axes)
    reach, floor = held.reach, SMALLEST_GAP * held.reach + held.floor(placed=held.is_placed, angle=least_angle)
    why: Why = lambda words: undetermined(  # noqa: E731
        f"beside one exact direction {words}. Add a direction across it of positive weight"
    )
    require_determined(lambda_1, gap, reach, floor, why)
    along = axes[1][:, 0]
    return RotationBeside(R, gap / reach, np.outer(along, along) / (0.5 * gap), 1)


def solve_beside(
    matches: Matches, exact_points: BoolArray | None, exact_directions: BoolArray | None, *, absolute_weights: bool
) -> Fit:
    """`solve` where some rows, of weight zero in ``matches``, are exact: masks, an entry a row or one for all."""
    m = matches
    beta, alpha = weights_of(m)
    held, along = _mask(exact_points, len(beta)), _mask(exact_directions, len(alpha))
    refuse_bad_values(replace(m, direction_weights=alpha + along))
    require_squares(beta, m.points_source, m.points_target)
    require_squares(alpha, m.directions_source, m.directions_target)
    if not (held.any() or beta.any()):
        raise DegenerateGeometryError(no_weight_message())
    # One of the exact points and not their mean, which would round: two leave one direction, and no angle beside it.
    p0, q0 = (
        side[held.argmax()] if held.any() else beta @ side / beta.sum() for side in (m.points_source, m.points_target)
    )
    about = _about(m.points_source, p0), _about(m.points_target, q0)
    found = _rotation(m, held, along, about, (p0, q0))
    T = np.eye(4)
    T[:3, :3] = found.R
    T[:3, 3] = (q0 - p0) - (found.R - np.eye(3)) @ p0
    _refuse_contradictions(found.R, m, held, along, about)
    point_cost, direction_cost = cost_of_pose(T, m)
    weight, free = float(beta.sum()), found.free + (0 if held.any() else 3)
    variance = 1.0
    if free and not absolute_weights:
        variance = residual_variance(point_cost + direction_cost, counted(beta, 0), counted(alpha, 0), free)
    sums = FitUncertainty(np.zeros((3, 3)), math.inf if held.any() else weight, q0, variance, found.covariance)
    rms = math.sqrt(point_cost / weight) if weight > 0.0 else 0.0
    return Fit(T, point_cost + direction_cost, rms, found.gap, uncertainty=sums)


def _mask(exact: BoolArray | None, count: int) -> BoolArray:
    return np.zeros(count, dtype=bool) | (False if exact is None else exact)


def _about(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Points less the origin; zero where that is rounding of the coordinates."""
    away = points - origin
    grain = SAME_POINT * np.maximum(np.linalg.norm(points, axis=1), np.linalg.norm(origin))
    away[np.linalg.norm(away, axis=1) <= grain] = 0.0
    return away


def _rotation(m: Matches, held: BoolArray, along: BoolArray, about: Pair, origins: Pair) -> RotationBeside:
    # A place counts where both sides have one; in units of their extent lengths weigh as directions do.
    apart = held & about[0].any(axis=1) & about[1].any(axis=1)
    source, target = (
        np.vstack([points[apart] / (_longest(points[apart]) or 1.0), directions])
        for points, directions in zip(about, _units(m, along), strict=True)
    )
    beta, alpha = weights_of(m)
    others = Matches(*about, m.directions_source, m.directions_target, beta, alpha)
    grains = [
        grain_of(beta.sum(), math.hypot(*origin), beta @ (points * points).sum(axis=1))
        for origin, points in zip(origins, (m.points_source, m.points_target), strict=True)
    ]
    extent, far = _reach(m, held, about)
    least_angle = 10.0 * EXACT_TOLERANCE + (4.0 * SAME_POINT * far / extent if extent > 0.0 else 0.0)
    try:
        return rotation_beside((source, target), others, np.array(grains), least_angle)
    except DegenerateGeometryError as error:
        raise DegenerateGeometryError(
            f"the exact matches (infinite weight: {int(held.sum())} points, {int(along.sum())} directions) and the "
            "others about them leave a rotation open. Add a point or a direction of positive weight off their line"
        ) from error


def _refuse_contradictions(R: FloatArray, m: Matches, held: BoolArray, along: BoolArray, about: Pair) -> None:
    units = _units(m, along)
    miss, tilt = _longest(about[0][held] @ R.T - about[1][held]), _longest(units[0] @ R.T - units[1])
    extent, far = _reach(m, held, about)
    if miss > EXACT_TOLERANCE * extent + 4.0 * SAME_POINT * far or tilt > EXACT_TOLERANCE:
        raise InputError(
            f"the exact matches (infinite weight) contradict each other: at best points miss by {miss:.3g} of an "
            f"extent of {extent:.3g} and directions by {tilt:.3g} rad; they must agree to "
            f"{EXACT_TOLERANCE:g}. Give those that are measured a large finite weight, such as 1e6 times that of the "
            "others"
        )


def _reach(m: Matches, held: BoolArray, about: Pair) -> tuple[float, float]:
    """Extent of the exact points, and their distance from the origin."""
    return max(_longest(side[held]) for side in about), max(
        _longest(side[held]) for side in (m.points_source, m.points_target)
    )


def _units(m: Matches, along: BoolArray) -> Pair:
    source, target = m.directions_source[along], m.directions_target[along]
    return source / np.linalg.norm(source, axis=1)[:, None], target / np.linalg.norm(target, axis=1)[:, None]


def _longest(rows: FloatArray) -> float:
    return float(np.linalg.norm(rows, axis=1).max(initial=0.0))
