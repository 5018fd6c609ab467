"""Covariance of a fit from its own residuals: scatter between patches, and noise that neighbouring patches share."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray, IntArray, median, product
from dqreg.solvers.row_sums import Patches, PatchSums, RowSums

# Patches of neighbouring correspondences whose noise may be common; the fewest from which a scatter can be estimated.
PATCH_COUNT, MIN_PATCHES = 200, 30
# Smaller patches, between which noise that is shared more widely is estimated.
SMALL_PATCH_COUNT = 500
# Patches along the curve whose agreement is tested first, because that costs nearly nothing.
NEXT_PATCHES = 4
# Points that tell the noise along a motion that they alone hold.
ENOUGH_CARRIERS = 100.0
# Standard errors of independent noise that this first test, and then the agreement at the best range, must exceed.
# Of 120 scans with independent noise the first reached 2.2, the second 2.4.
NEIGHBOUR_SIGMAS, SHARED_SIGMAS = 1.5, 3.0
# A patch of less than this share of the weight of the heaviest is of outliers: how far off they are is no noise.
LIGHT_WEIGHT_SHARE = 0.1
# A fit that follows more of the noise than this leaves too little to tell its size by.
MIN_NOISE_SHARE = 0.25
# Ranges tried, in distances between patches, and the longest as a fraction of the extent.
RANGE_DISTANCES: FloatArray = np.asarray(1.5 * 2.0 ** (0.5 * np.arange(16)), dtype=np.float64)
LONGEST_RANGE_EXTENTS = 0.5
# Information below this fraction of the largest is none: the smooth surface may constrain what the facets leave free.
SINGULAR_SHARE = 1e-9
# Bins of the distances, up to the farthest range.
DISTANCE_BINS = 256
# Unknowns are filled up to a multiple of this: as many at a time processors take.
UNKNOWNS_TOGETHER = 8


@dataclasses.dataclass(frozen=True, eq=False)
class Starts:
    """First rows of patches."""

    large: Patches
    small: Patches
    all: IntArray  # Those of patches of which both kinds are made, the first row of all among them

    @staticmethod
    def of(large: IntArray, small: IntArray) -> Starts:
        """From those of larger and of smaller patches."""
        united = np.union1d(np.zeros(1, dtype=np.int64), np.concatenate([large, small])).astype(np.int64)
        larger_ones, smaller_ones = (Patches(some, np.searchsorted(united, some)) for some in (large, small))
        return Starts(larger_ones, smaller_ones, united)


def scatter_of(
    rows: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    known: FloatArray,
    variance: float,
) -> FloatArray | None:
    """Covariance of a weighted least-squares fit with residuals of one patch taken as dependent.

    The sandwich ``A^-1 B A^-1`` of the information A and the scores of the patches, ``B = sum s_g s_g^T`` with ``s_g =
    sum w J r`` (White 1980; Liang and Zeger 1986). Where neighbouring patches deviate to the same side more than chance
    explains, their covariance is added: a vector field of noise whose correlation falls with the distance by the
    spherical model of geostatistics, its size and range estimated from the products of the patches' means.

    Patches without weight, of a table or beyond the overlap of two scans, are left out of that.

    Shapes: rows (k, n), known (k, k), returns (k, k).
    """
    sums = RowSums(rows, points, normals, residuals, weights)
    return scatter_of_sums(sums, patch_starts(len(weights), None), known, variance)


def scatter_of_sums(sums: PatchSums, starts: Starts, known: FloatArray, variance: float) -> FloatArray | None:
    """The same from sums over patches, given the starts of these."""
    large, small = starts.large, starts.small
    # Patches tell the scatter of fewer unknowns than there are of them.
    if len(large.starts) < MIN_PATCHES or len(large.starts) <= len(known) + 1:
        return None
    information = sums.information() + known
    values = np.linalg.eigvalsh(information)
    if not values[0] > SINGULAR_SHARE * values[-1]:
        return None
    bread = np.asarray(np.linalg.inv(information), dtype=np.float64)
    coarse = _with_model(_sandwich(bread, sums.over(large)[0], variance * known), variance * bread, len(large.starts))
    scores, beside = sums.over(small)
    patches = _Patches.of(beside)
    if patches.agreement < NEIGHBOUR_SIGMAS:
        return coarse
    shared = patches.shared_noise()
    if shared is None:
        return coarse
    between, left = patches.between_and_left(*shared, *sums.pulls(small), bread)
    fine = _sandwich(bread, scores, variance * known)
    return larger(coarse, fine + bread @ (between / left) @ bread)


def patch_starts(total: int, counts: FloatArray | None) -> Starts:
    """First rows of the larger and of the smaller patches of so many rows, of as many points each."""
    if counts is None:
        return _even_starts(total)
    passed = np.cumsum(counts)
    return Starts.of(_starts(total, PATCH_COUNT, passed), _starts(total, SMALL_PATCH_COUNT, passed))


@lru_cache(maxsize=16)
def _even_starts(total: int) -> Starts:
    # The same for every scan of so many points.
    return Starts.of(_starts(total, PATCH_COUNT, None), _starts(total, SMALL_PATCH_COUNT, None))


def _starts(total: int, most: int, passed: FloatArray | None) -> IntArray:
    patches = min(most, total // 8)
    if passed is None or not patches:
        return np.linspace(0, total, patches, endpoint=False).astype(np.int64)
    starts = np.searchsorted(passed, np.linspace(0.0, passed[-1], patches, endpoint=False), side="right")
    return np.asarray(starts[np.diff(starts, prepend=-1) > 0])


def _sandwich(bread: FloatArray, scores: FloatArray, known: FloatArray) -> FloatArray:
    count, motions = scores.shape
    meat = scores.T @ scores * count / (count - motions - 1.0) + known
    scatter: FloatArray = bread @ meat @ bread
    return scatter


def _with_model(scatter: FloatArray, model: FloatArray, patches: int) -> FloatArray:
    """A sandwich of few patches, which leverage makes too small, with a share of what equal variances would give.

    In no direction is it smaller than before. Of 30 patches squared errors came to 1.2 to 1.6 of the variance, now to
    0.9 to 1.0 where noise is alike and 0.7 where it differs between faces.
    """
    share = 1.0 - patches / PATCH_COUNT
    return scatter if share <= 0.0 else larger(scatter, (1.0 - share) * scatter + share * model)


def with_few(scatter: FloatArray, model: FloatArray, carriers: FloatArray) -> FloatArray:
    """The scatter, (m, m), with a share of what equal variances, (m,), would give along motions that few points hold.

    The residuals of twenty points tell their noise to a sixth, and of all mixtures of the motions that they hold one is
    the luckiest. In no direction is it smaller than before.
    """
    if carriers.min(initial=ENOUGH_CARRIERS) >= ENOUGH_CARRIERS:
        return scatter
    shares = np.clip(1.0 - carriers / ENOUGH_CARRIERS, 0.0, 1.0)
    kept = np.sqrt(1.0 - shares)
    return larger(scatter, scatter * np.outer(kept, kept) + np.diag(shares * model))


def with_known(scatter: FloatArray, known: FloatArray) -> FloatArray:
    """A covariance, (m, m), whose information is in no direction less than what was known beforehand, (m, m)."""
    if not known.any():
        return scatter
    axes, spreads, _ = np.linalg.svd(scatter)
    roots = axes * np.sqrt(spreads)
    vectors, shares, _ = np.linalg.svd(roots.T @ known @ roots)
    turned = roots @ vectors
    return np.asarray((turned / np.maximum(shares, 1.0)) @ turned.T)


def larger(one: FloatArray, other: FloatArray) -> FloatArray:
    """In every direction the larger of two covariances: in axes where one is the identity, and the other diagonal."""
    # Singular values and vectors of a covariance are its eigenvalues and axes. `eigh` wakes the threads of BLAS from 26
    # unknowns on, `svd` does not.
    axes_one, spreads, _ = np.linalg.svd(one)
    # Exact data leave directions without any scatter.
    roots = np.sqrt(np.maximum(spreads, SINGULAR_SHARE * spreads[0]))
    if not roots.all():
        return other
    inverse = axes_one / roots
    vectors, values, _ = np.linalg.svd(inverse.T @ other @ inverse)
    axes = (axes_one * roots) @ vectors
    both: FloatArray = (axes * np.maximum(values, 1.0)) @ axes.T
    return both


@dataclasses.dataclass(frozen=True)
class _Patches:
    """Means over patches of neighbouring correspondences; normals and residuals zero for patches of outliers."""

    points: FloatArray
    normals: FloatArray
    residuals: FloatArray
    weights: FloatArray  # Sums
    variance: float  # Mean square of the residuals of the others
    agreement: float  # Of patches that follow each other, in standard errors of independent noise

    @staticmethod
    def of(sums: FloatArray) -> _Patches:
        """From weights, and weighted points, normals and residuals, (m, 8)."""
        from dqreg.kernels.evidence.patch_sums import patch_means
        from dqreg.kernels.threads import as_plain

        points, normals = np.zeros((2, len(sums), 3))
        residuals, weights = np.zeros((2, len(sums)))
        means = points, normals, residuals, weights
        return _Patches(*means, *patch_means(as_plain(sums), LIGHT_WEIGHT_SHARE, NEXT_PATCHES, *means))

    def shared_noise(self) -> tuple[float, float] | None:
        """Variance and range of the noise that neighbouring patches share; None where chance explains it."""
        from dqreg.kernels.evidence.patch_pairs import best_range, binned_agreements, nearest_others

        nearest, products, squared = np.zeros(len(self.points)), np.zeros(DISTANCE_BINS), np.zeros(DISTANCE_BINS)
        far = LONGEST_RANGE_EXTENTS * nearest_others(self.points, nearest)
        if not far > 0.0:
            return None
        binned_agreements(self.points, self.normals, self.residuals, far, products, squared)
        sill, reach, excess = best_range(median(nearest) * RANGE_DISTANCES, products, squared, far, self.variance)
        return None if excess < SHARED_SIGMAS else (sill, reach)

    def between_and_left(
        self, sill: float, reach: float, pulls: FloatArray, along: FloatArray, bread: FloatArray
    ) -> tuple[FloatArray, float]:
        """Sum of ``P^T S P`` over the pulls P along each axis for a covariance S between patches; its share left.

        That is what the fit leaves of it in their residuals: it has followed the rest. These are ``P^T e`` of the
        errors e, so that products of theirs tell ``P^T K P`` where K was meant (Patterson and Thompson 1971).

        Shapes: pulls (m, k): weighted rows of each patch, along (m, 3, k), bread (k, k); returns (k, k).
        """
        from dqreg.kernels.evidence.patch_pairs import covariance_sums

        count, unknowns = pulls.shape
        # What the fit follows of errors is H e, H = X bread X^T W with the mean rows X.
        hat, wide = (pulls / self.weights[:, None]) @ bread, unknowns + -unknowns % UNKNOWNS_TOGETHER
        axes, earlier = np.zeros((2, count, 3, wide))
        others, found = np.zeros((2, count, 2, wide))
        axes[:, :, :unknowns], others[:, 0, :unknowns], others[:, 1, :unknowns] = along, hat, pulls
        columns = (each.reshape(count, -1) for each in (axes, others, earlier, found))
        squares = covariance_sums(self.points, self.normals, sill, reach, *columns)
        half = product(axes.reshape(-1, wide).T, earlier.reshape(-1, wide))[:unknowns, :unknowns]
        held, pulled = found[:, 0, :unknowns], found[:, 1, :unknowns]
        followed = 2.0 * float(np.vdot(held, pulled)) - float(np.vdot(hat.T @ held, pulled.T @ pulls))
        return half + half.T, max(1.0 - followed / squares, MIN_NOISE_SHARE) if squares > 0.0 else 1.0
