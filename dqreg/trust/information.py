"""Information about the six motions of the part, from distances along the target's normals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, dot
from dqreg.rigid.twist import scaling_by
from dqreg.solvers.row_sums import FREE_SHARE, NO_NORMALS, MotionSums
from dqreg.solvers.sandwich import Starts, patch_starts, scatter_of_sums, with_few, with_known
from dqreg.trust.normal_constraints import carriers_of, unconfirmed

# What was known beforehand of a motion, below this fraction of what was of another, is rounding.
UNKNOWN_SHARE = 2e-14
# One patch of all rows.
ONE_PATCH = np.zeros(1, dtype=np.int64)
# The least weight to divide by.
TINY = float(np.finfo(np.float64).tiny)
Columns = tuple[FloatArray, FloatArray]


@dataclasses.dataclass(frozen=True)
class Information:
    """Information about the six motions in units that compare rotations with translations.

    A twist (rotation vector w, translation v) about the centre is scaled to (w L, v) with the lever L, half the
    diagonal, so that all six numbers are displacements on the part.

    Attributes
    ----------
    values : ndarray, (k,)
        Six, or fewer where motions were locked: eigenvalues over the sum of weights, ascending; about 1 where every
        correspondence resists a motion.
    vectors : ndarray, (6, k)
        Scaled twists, one a column.
    weight : float
        Sum of weights.
    sigma : float
        Standard deviation of a correspondence's distance along the normal.
    lever : float
        The length L.
    centre : ndarray, (3,)
        Centre of the rotations, target frame.
    carriers : ndarray, (k,)
        Number of correspondences, about, that constrain each motion: as many equal ones would do it as well. Where the
        target's normals are estimates, those on which the normals of both sides agree.
    scatter : ndarray, (6, 6), or None
        Covariance of the scaled twist, estimated from the scatter of the residuals between patches; zero along free
        motions. None takes ``sigma^2`` for every correspondence, each independent.
    by_rims : float
        Standard deviation, as a displacement, along the free motions where the rims of the target constrain them; NaN
        where they do not.
    tilt : ndarray, (6,)
        Standard deviation of each coordinate of the free motions, as unit vectors: errors of the normals tilt them.
    beforehand : ndarray of bool, (k,)
        Motions that no normal constrains, and a prior does: what it says is all that is known of them.
    """

    values: FloatArray
    vectors: FloatArray
    weight: float
    sigma: float
    lever: float
    centre: FloatArray
    carriers: FloatArray = dataclasses.field(default_factory=lambda: np.full(6, np.inf))
    scatter: FloatArray | None = None
    by_rims: float = math.nan
    tilt: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(6))
    beforehand: BoolArray = dataclasses.field(default_factory=lambda: np.zeros(6, dtype=bool))

    @property
    def free(self) -> BoolArray:
        """Which of the six motions nothing constrains, neither a normal nor a prior, (k,)."""
        return np.asarray((self.values < FREE_SHARE) & ~self.beforehand)

    @property
    def spread(self) -> FloatArray:
        """Covariance of the scaled twist, (6, 6): the scatter, or that of equal and independent correspondences."""
        if self.scatter is not None:
            return self.scatter
        held = ~self.free
        scaled: FloatArray = (self.vectors[:, held] / (self.values[held] * self.weight)) @ self.vectors[:, held].T
        return scaled * self.sigma**2

    @property
    def effective(self) -> float:
        """Independent correspondences that leave as much uncertainty as these; the sum of weights without a scatter."""
        if self.scatter is None:
            return self.weight
        held = ~self.free
        alone = float((1.0 / self.values[held]).sum()) * self.sigma**2
        found = float(np.trace(self.scatter))
        return alone / found if found > 0.0 else self.weight


def information_of(
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    lever: float,
    centre: FloatArray,
    smooth: FloatArray | None = None,
    *,
    own: FloatArray | None = None,
    patchwise: bool = False,
    allowed: FloatArray | None = None,
    prior: FloatArray | None = None,
    counts: FloatArray | None = None,
    scattered: FloatArray | float = 0.0,
) -> Information:
    """Information from distances along the target's normals: sliding along a face changes none.

    With rows ``J_i = [(x_i - c) x n_i, n_i]`` it is ``sum w_i J_i^T J_i``, the Gauss-Newton Hessian of the
    point-to-plane cost.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Source points in the target frame.
    normals : ndarray, (n, 3)
        Target normals; a zero row adds nothing.
    residuals : ndarray, (n,)
        Distances along the normals.
    weights : ndarray, (n,)
        Weights of the correspondences, probabilities to be an inlier.
    lever : float
        Half the diagonal of the target.
    centre : ndarray, (3,)
        Middle of the target.
    smooth : ndarray, (n, 3), optional
        Normals of the smooth surface that the target's facets approximate: they decide what is free, because facets
        would constrain the rotation of a round shaft.
    own : ndarray, (n, 3), optional
        Normals of the source points in the target frame, up to sign, where those of the target are estimates: errors of
        the two are independent, so what both say is shape. A zero row says nothing.
    patchwise : bool
        Whether the covariance is estimated from the scatter of the residuals between patches (points in Morton
        order), which accounts for noise that differs between faces or is shared by neighbours; see `scatter_of`.
    allowed : ndarray, (6, k), optional
        Twists about the centre that the pose may still take, one a column; the others were locked.
    prior : ndarray, (6, 6), optional
        Information about the twist that was known beforehand.
    counts : ndarray, (n,), optional
        Points that each row represents, where it is the mean of several; the weight is of all of them.
    scattered : ndarray, (n,), or float
        Mean squared distance of those from their mean, along the normal.

    Returns
    -------
    Information
        Eigenvalues, motions and noise.

    Examples
    --------
    >>> flat = np.column_stack([np.random.default_rng(0).uniform(-1, 1, (50, 2)), np.zeros(50)])
    >>> up = np.tile([0.0, 0, 1], (50, 1))
    >>> info = information_of(flat, up, np.zeros(50), np.ones(50), 1.0, np.zeros(3))
    >>> int(info.free.sum())
    3
    """
    total = float(weights.sum())
    scaling = scaling_by(lever)
    basis = np.eye(6) if allowed is None else np.linalg.qr(allowed * scaling[:, None])[0]
    smooth = normals if smooth is None else smooth
    starts = patch_starts(len(weights), counts) if patchwise else None
    first = ONE_PATCH if starts is None else starts.all
    sums = MotionSums.of(points, normals, smooth, residuals, weights, centre, lever, first, basis, own)
    aside = dot(weights, scattered) if isinstance(scattered, np.ndarray) else total * scattered
    variance = (sums.squares() + aside) / max(total - 6.0, 1.0)
    # What was known beforehand, by the scaled twist, and in the units of the correspondences' own information.
    told = np.zeros((basis.shape[1],) * 2)
    if prior is not None:
        told = basis.T @ (prior / scaling / scaling[:, None]) @ basis
    of_all, of_smooth = max(total, TINY), sums.of_smooth()
    denied = np.zeros((basis.shape[1], 0)) if own is None else unconfirmed(sums, FREE_SHARE * of_all)
    if prior is not None:
        denied = _with_free(denied, of_smooth / of_all)
    values, vectors, said, is_denied, beforehand = _parted(of_smooth, variance, told, of_all, denied)
    outer, free = basis @ vectors, (values < FREE_SHARE) & ~beforehand
    sides = (points, smooth, NO_NORMALS) if own is None else (points, normals, own)
    carriers = carriers_of(*sides, outer, weights, counts, centre, lever)
    carriers[is_denied] = 0.0
    by_shape = ~(free | is_denied)
    few = variance / (values[by_shape] * of_all), carriers[by_shape]
    scatter = _scatter(sums, starts, told, variance, (vectors[:, by_shape], vectors[:, beforehand]), few)
    tilt = _tilt(free, values, said, outer, weights)
    sigma = math.sqrt(variance)
    return Information(values, outer, total, sigma, lever, centre, carriers, scatter, tilt=tilt, beforehand=beforehand)


def _scatter(
    sums: MotionSums, starts: Starts | None, told: FloatArray, variance: float, motions: Columns, few: Columns
) -> FloatArray | None:
    """Covariance of the scaled twist from motions that the shape holds, (k, m), and those of a prior alone, (k, n).

    None where there is none of the second kind, and too few patches. Of the first it is given what equal variances come
    to, (m,), and how many points hold each. Shapes: told (k, k), returns (6, 6).
    """
    by_shape, alone = motions
    known, turned, beside = by_shape.T @ told @ by_shape, by_shape, np.zeros((6, 0))
    scatter: FloatArray | None = None
    if alone.shape[1]:
        # What the prior says of a motion of its own depends on the others, as far as it knows them together.
        strengths = np.einsum("ij,ik,kj->j", alone, told, alone)
        together = alone.T @ told @ by_shape
        known = known - (together.T / strengths) @ together
        turned = by_shape - (alone / strengths) @ together
        beside = sums.basis @ (alone / np.sqrt(strengths))
    if starts is not None and by_shape.shape[1]:
        # Facets have an information of their own.
        scatter = scatter_of_sums(sums.combined(by_shape), starts, variance * known, variance)
    if scatter is not None:
        scatter = with_known(with_few(scatter, *few), known)
    if scatter is None and alone.shape[1]:
        scatter = variance * np.asarray(np.linalg.inv(by_shape.T @ sums.of_smooth() @ by_shape + variance * known))
    outer = sums.basis @ turned
    return None if scatter is None else np.asarray(outer @ scatter @ outer.T + beside @ beside.T)


def held_part(
    points: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    lever: float,
    smooth: FloatArray | None = None,
    own: FloatArray | None = None,
) -> FloatArray | None:
    """What a twist about the origin is multiplied with to leave what the shape holds, (6, 6); None where it holds all.

    See `information_of`: what the normals of facets, or errors of normals, say of the rest is nothing to go by.
    """
    origin, total = np.zeros(3), max(float(weights.sum()), TINY)
    smooth = normals if smooth is None else smooth
    columns = points, normals, smooth, np.zeros(len(weights)), weights
    sums = MotionSums.of(*columns, origin, lever, ONE_PATCH, np.eye(6), own)
    denied = np.zeros((6, 0)) if own is None else unconfirmed(sums, FREE_SHARE * total)
    denied = _with_free(denied, sums.of_smooth() / total)
    if not denied.shape[1]:
        return None
    axes, scaling = np.linalg.qr(denied)[0], scaling_by(lever)
    return np.asarray(np.eye(6) - axes @ axes.T) * scaling / scaling[:, None]


def _with_free(denied: FloatArray, of_smooth: FloatArray) -> FloatArray:
    """Motions that are denied already, (k, m), and those that no normal constrains, (k, n)."""
    values, vectors = np.linalg.eigh(of_smooth)
    return np.hstack([denied, vectors[:, values < FREE_SHARE]])


def _parted(
    of_smooth: FloatArray, variance: float, told: FloatArray, of_all: float, denied: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, BoolArray]:
    """Eigenvalues, ascending, and vectors of what is known of denied motions, (k, m), and of all else beside these.

    Of a motion that both sides do not confirm, what was known beforehand is left; and of one that none holds. And what
    all normals say of each, which are denied, and of which of these something was known beforehand, (k,) each.
    """
    whole, count = (of_smooth + variance * told) / of_all, denied.shape[1]
    if not count:
        values, vectors = np.linalg.eigh(whole)
        values, none = np.maximum(values, 0.0), np.zeros(len(values), dtype=bool)
        return values, vectors, values, none, none
    axes = np.linalg.qr(denied, mode="complete")[0]
    parts = [(variance * told / of_all, axes[:, :count]), (whole, axes[:, count:])]
    found = [np.linalg.eigh(part.T @ matrix @ part) for matrix, part in parts]
    values = np.maximum(np.concatenate([one for one, _ in found]), 0.0)
    vectors = np.hstack([part @ turned for (_, part), (_, turned) in zip(parts, found, strict=True)])
    said = np.maximum(np.einsum("ij,ik,kj->j", vectors, whole, vectors), 0.0)
    is_denied = np.arange(len(values)) < count
    beforehand = is_denied & (np.einsum("ij,ik,kj->j", vectors, told, vectors) > UNKNOWN_SHARE * np.trace(told))
    values[is_denied & ~beforehand] = 0.0
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order], said[order], is_denied[order], beforehand[order]


def _tilt(
    free: BoolArray, values: FloatArray, said: FloatArray, vectors: FloatArray, weights: FloatArray
) -> FloatArray:
    """Standard deviation of each coordinate of the free motions, (6,), from what all normals say of the motions, (k,).

    What they say of a free motion is their errors. To first order these mix a held motion j into a free one i with the
    variance ``said_i / (said_j n)`` of n independent normals.
    """
    if not free.any() or free.all():
        return np.zeros(6)
    independent = float(weights.sum()) ** 2 / dot(weights, weights)
    held = np.maximum(said, values)[~free]
    return np.asarray(np.sqrt(said[free].sum() / independent * (vectors[:, ~free] ** 2 @ (1.0 / held))))
