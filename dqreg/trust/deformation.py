"""Whether two clouds, or a scan and a part, differ by more than a motion: all smooth deformations tested together.

Each single strain may be known badly, because a motion nearly undoes it: of three faces about a corner a stretch shows
only in the angles between them. All of them together are significant long before one is.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg.solvers.quadratic import plane_rows
from dqreg.trust.robust_fit import RobustFit, best_motion, robust_fit, unexplained, weights_of
from dqreg.trust.strain import COMPONENTS
from dqreg.trust.waviness import common_share


class Limit(NamedTuple):
    """From where on a deformation is told."""

    sigmas: float  # Significance of all its modes together
    shown: float  # Displacement of the surface along its normals that no motion explains, root mean square, in sizes
    displaced: float  # The same of the points in all directions: smaller deformations are no fault
    # Share of the variance that neighbours have in common in what it leaves, at most: scatter does not know all of that
    common: float = math.inf


class Limits(NamedTuple):
    """From where on a deformation is told: by any of each."""

    few: tuple[Limit, ...]  # Of strains, bends and a torsion
    many: tuple[Limit, ...]  # Of strains and all other fields that are quadratic in the place


# Large ones and small ones. Right poses of generated views came to 21.8 standard deviations at 2.0e-4 and to 33, where
# two in five had noise that neighbours share, of measured pairs to 15.3 and 35; most strains of 1.5 to 6 % came to 30
# and more. Sweeps of a moving LiDAR came to 48 and 70 where they displace less than this. Where neighbours have nothing
# in common beside strains and bends, right poses came to 14 at 1.4e-4 and 19 at 1.3e-4, strains that had been accepted
# to 20.8 and 22.7 at 1.9e-4; where they have much, a right pose to 26 at 1.8e-4. Fields of more numbers take in what
# neighbours share, and beside them nothing in common tells nothing: right poses came to 29 at 3.2e-4, 40 at 4.3e-4.
MUCH_IN_COMMON, NOTHING_IN_COMMON = 0.2, 0.06
BETWEEN_CLOUDS = Limits(
    (
        Limit(18.0, 2.5e-4, 1.5e-3),
        Limit(24.0, 1.2e-4, 1.5e-3, MUCH_IN_COMMON),
        Limit(40.0, 1.2e-4, 1.5e-3),
        Limit(18.0, 1.65e-4, 1.5e-3, NOTHING_IN_COMMON),
    ),
    (Limit(40.0, 2e-4, 9e-4),),
)
# Of a scan of a part: made parts warp a little, and a bend of 0.2 % (`dqreg.trust.strain.MIN_BEND`) shows so much.
# Right poses of generated scans came to 10 standard deviations at 5e-4, those on bent parts to 85 and more at 6.4e-4.
ON_A_PART = Limits((Limit(40.0, 5e-4, 9e-4),), (Limit(40.0, 5e-4, 9e-4),))
# Share of what is shown that residuals have beyond the noise at least.
EXCESS_SHARE = 0.7
# Share of a limit below which what two rounds of a fit of all fields find is not fitted to its end.
NEGLIGIBLE_SHARE = 0.5
# Numbers of a motion, of bends and a torsion, and of fields that are quadratic in the place.
MOTION_NUMBERS = 6
BEND_NUMBERS = 3
QUADRATIC_NUMBERS = 18
# Places for each number that is fitted: with fewer, all that neighbours have in common looks like some deformation.
PLACES_PER_NUMBER = 16


def deformation_of(
    points: FloatArray, normals: FloatArray, residuals: FloatArray, size: float, limits: Limits = BETWEEN_CLOUDS
) -> float:
    """Displacement of the surface by a significant deformation that no motion explains, root mean square; 0 for none.

    It is along the normals: what slides within the surface is known badly.

    Shapes: points (n, 3) in the order of a space-filling curve, normals (n, 3), residuals (n,).
    """
    arms = points - points.mean(axis=0)
    lever = float(np.sqrt(np.einsum("ij,ij->", arms, arms) / len(arms)))
    if not lever > 0.0:
        return 0.0
    # In the frame of the longest axes.
    axes = np.linalg.eigh(arms.T @ arms)[1][:, ::-1]
    p, n = arms @ axes / lever, normals @ axes
    if not _may_be_told(p, n, residuals, lever, limits, size):
        return 0.0
    strains = _strains(p)
    for others, count, told in ((_bends, BEND_NUMBERS, limits.few), (_quadratics, QUADRATIC_NUMBERS, limits.many)):
        if len(points) < PLACES_PER_NUMBER * (MOTION_NUMBERS + len(strains) + count):
            continue
        fields = np.concatenate([strains, others(p)])
        found = _explained(fields, p * lever, n, residuals, lever, told, size)
        if any(found.exceeds(limit, size) for limit in told):
            return found.shown
    return 0.0


def _strains(p: FloatArray) -> FloatArray:
    """Displacements of places by unit strains, (6, n, 3)."""
    unit = np.eye(3)
    return np.stack([p[:, [j]] * unit[i] + (p[:, [i]] * unit[j] if i != j else 0.0) for i, j in COMPONENTS])


def _bends(p: FloatArray) -> FloatArray:
    """The same by bends of the first axis, whose sections turn with it, and by a torsion about it, (3, n, 3)."""
    x, y, z = p.T
    nothing = np.zeros_like(x)
    fields = ((-2.0 * x * y, x**2, nothing), (-2.0 * x * z, nothing, x**2), (nothing, x * z, -x * y))
    return np.stack([np.column_stack(field) for field in fields])


def _quadratics(p: FloatArray) -> FloatArray:
    """The same by all fields that are quadratic in the place, (18, n, 3)."""
    return np.stack([(p[:, j] * p[:, k])[:, None] * axis for axis in np.eye(3) for j, k in COMPONENTS])


def _may_be_told(
    p: FloatArray, n: FloatArray, residuals: FloatArray, lever: float, limits: Limits, size: float
) -> bool:
    """Whether a fit of all fields at once finds about as much as some limit asks for, by two robust rounds or by all.

    Bends are among the quadratic fields: with the same weights, no fewer modes explain more, whatever the scatter. What
    the first rounds leave out, as a ledge beside wide faces, later ones may take in; it has its say where all count.
    """
    motions = plane_rows(p * lever, n, np.zeros(3), lever)
    products = np.stack([p[:, j] * p[:, k] for j, k in COMPONENTS])
    strains = [p[:, j] * n[:, i] + (p[:, i] * n[:, j] if i != j else 0.0) for i, j in COMPONENTS]
    modes = np.concatenate([np.stack(strains), *(products * axis for axis in n.T)])
    rows, ones = np.concatenate([motions, modes]), np.ones(len(residuals))
    fits = (
        robust_fit(rows, residuals, lever, weights_of(residuals), rounds=2),
        # As the first round weighs them: all alike.
        dataclasses.replace(robust_fit(rows, residuals, lever, ones, rounds=1), weights=ones),
    )
    least = [
        Limit(NEGLIGIBLE_SHARE * told.sigmas, NEGLIGIBLE_SHARE * told.shown, 0.0)
        for told in (*limits.few, *limits.many)
    ]
    found = (_gained(fit, len(motions)) for fit in fits)
    return any(each.exceeds(limit, size) for each in found for limit in least)


class _Found(NamedTuple):
    sigmas: float  # Standard deviations of all modes together
    shown: float  # Displacement along the normals that no motion explains, root mean square
    displaced: float  # Displacement of the points, likewise
    common: float = 0.0  # Share of the variance that neighbours have in common in what they leave

    def exceeds(self, limit: Limit, size: float) -> bool:
        """Whether it is told, of clouds of a size."""
        matters = self.shown >= limit.shown * size and self.displaced >= limit.displaced * size
        return self.sigmas >= limit.sigmas and matters and self.common <= limit.common


# What is found where nothing is.
_NOTHING = _Found(0.0, 0.0, 0.0)


def _explained(
    fields: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    lever: float,
    told: tuple[Limit, ...],
    size: float,
) -> _Found:
    """What some fields, (k, n, 3), explain of the residuals beside a motion; zeros where it is below all limits."""
    motions = plane_rows(points, normals, np.zeros(3), lever)
    modes = np.einsum("kni,ni->kn", fields, normals)
    fit = robust_fit(np.vstack([motions, modes]), residuals, lever, weights_of(residuals))
    if not fit.variance > 0.0:
        return _NOTHING
    of_modes = fit.fitted[len(motions) :]
    found = _gained(fit, len(motions))
    if any(found.exceeds(limit, size) for limit in told):
        kept = fit.weights > 0.0
        found = found._replace(common=common_share(fit.left[kept], normals[kept]))
    if not any(found.exceeds(limit, size) for limit in told):
        # Whatever the scatter: that takes longest.
        return _NOTHING
    scatter = fit.scatter(points, normals)
    if scatter is None:
        return _NOTHING
    covariance = scatter[len(motions) :, len(motions) :]
    covariance = covariance + np.eye(len(modes)) * 1e-12 * np.trace(covariance)
    sigmas = math.sqrt(max(float(of_modes @ np.linalg.solve(covariance, of_modes)), 0.0))
    found = found._replace(sigmas=min(sigmas, found.sigmas))
    if not any(found.exceeds(limit, size) for limit in told):
        return _NOTHING
    displaced = np.einsum("k,kni->ni", of_modes, fields)
    each = np.stack([plane_rows(points, np.broadcast_to(axis, points.shape), np.zeros(3), lever) for axis in np.eye(3)])
    by_points = unexplained(displaced.T.ravel(), np.concatenate([*each], axis=1), np.ones(3 * len(points)))
    return found._replace(displaced=math.sqrt(3.0) * by_points)


def _gained(fit: RobustFit, motions: int) -> _Found:
    """What modes after the first rows, those of the motions, gain over the best motion, and what of them it leaves.

    In the variance that is left: few patches underestimate the scatter.
    """
    rigid, modes, variance = fit.rows[:motions], fit.rows[motions:], fit.variance
    stiff = fit.residuals - best_motion(fit.residuals, rigid, fit.weights) @ rigid
    gained = dot(fit.weights, stiff**2 - fit.left**2)
    shown = unexplained(fit.fitted[motions:] @ modes, rigid, fit.weights)
    return _Found(math.sqrt(max(gained / variance, 0.0)) if variance > 0.0 else math.inf, shown, math.inf)


def may_be_deformed(width: float, noise: float, size: float) -> bool:
    """Whether residuals, one standard deviation, leave room beside their noise for a deformation on a part.

    >>> may_be_deformed(0.01, 0.01, 100.0), may_be_deformed(0.1, 0.01, 100.0)
    (False, True)
    """
    least = EXCESS_SHARE * ON_A_PART.few[0].shown * size
    return width > math.hypot(noise, least)
