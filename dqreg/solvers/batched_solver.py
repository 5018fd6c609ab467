"""`dqreg.solve_many`: thousands of small problems in one call, by the same closed form as `solve`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqreg._arrays import BoolArray, FloatArray
from dqreg._records import one_line
from dqreg.errors import InputError
from dqreg.kernels.threads import as_plain
from dqreg.solvers.batched_input import FeatureSet, Sides, read_features
from dqreg.solvers.batched_sums import BatchSums, residual_sums, sum_block
from dqreg.solvers.narrow_data import NARROW_RATIO, long_axes
from dqreg.solvers.rounding import SAME_POINT, SMALLEST_DIFFERENCE, SMALLEST_GAP, across_floor
from dqreg.solvers.uncertainty import FitUncertainty

# Numbers a block of problems holds a side: its temporaries stay in the cache.
BLOCK_NUMBERS = 16384


@dataclass(frozen=True, slots=True, eq=False)
class Fits:
    """One fit a problem; a degenerate problem has NaN in its pose, cost and rms, never an identity.

    Attributes
    ----------
    T_target_source : ndarray, (b, 4, 4)
        Poses that map source coordinates to target coordinates.
    cost, rms : ndarray, (b,)
        The minimised sums, from the residuals; the weighted root mean square distances of the points.
    eigenvalue_gap : ndarray, (b,)
        Relative gaps as `Fit` has them, of degenerate problems too; NaN where no point carries weight.
    degenerate : ndarray, (b,) of bool
        Where `solve` would raise `DegenerateGeometryError`.
    uncertainty : Uncertainty or None
        Sums that `covariance` follows from.
    """

    __repr__ = one_line
    T_target_source: FloatArray
    cost: FloatArray
    rms: FloatArray
    eigenvalue_gap: FloatArray
    degenerate: BoolArray
    uncertainty: FitUncertainty | None = None

    @property
    def centre(self) -> FloatArray:
        """Points that the increments of `covariance` turn about: the weighted means of the target points.

        Returns
        -------
        ndarray, (b, 3)
        """
        return np.full((len(self.cost), 3), np.nan) if self.uncertainty is None else self.uncertainty.centre

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the poses, each as `Fit.covariance`; computed at every call.

        Returns
        -------
        ndarray, (b, 6, 6)
            NaN for degenerate problems.
        """
        total = np.full((len(self.cost), 6, 6), np.nan)
        u, good = self.uncertainty, ~self.degenerate
        if u is not None and good.any():
            held = FitUncertainty(u.H[good], np.asarray(u.weight)[good], u.centre[good], np.asarray(u.variance)[good])
            total[good] = held.covariance(self.T_target_source[good, :3, :3], self.eigenvalue_gap[good])
        return total


def solve_many(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
    *,
    offsets: ArrayLike | None = None,
    direction_offsets: ArrayLike | None = None,
    absolute_weights: bool = False,
) -> Fits:
    """Solve b independent problems, each as `solve` would.

    Equal sizes come as (b, n, 3) arrays. Different sizes come as all rows below each other, (total, 3), with b + 1
    offsets: problem i holds the rows ``offsets[i]`` up to, without, ``offsets[i + 1]``. Points and directions may
    differ in form.

    Parameters
    ----------
    points_source, points_target : array_like, (b, n, 3) or (total, 3)
        Matched points.
    directions_source, directions_target : array_like, (b, m, 3) or (total, 3), optional
        Matched directions, weighed as given.
    point_weights, direction_weights : array_like, (b, n) or (total,), or float, optional
        beta and alpha >= 0, finite; 1 where not given, 0 rejects the match.
    offsets, direction_offsets : array_like of int, (b + 1,), optional
        From 0 up to the number of rows; equal neighbours are a problem without rows.
    absolute_weights : bool
        As in `solve`.

    Returns
    -------
    Fits
        Poses, costs, rms, gaps and the mask of degenerate problems. No degenerate problem disturbs another.

    Raises
    ------
    InputError
        If a shape, count, offset, weight or number anywhere is wrong: then nothing is solved.

    Examples
    --------
    >>> import numpy as np
    >>> triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> fits = solve_many([triangle, line], [triangle + 1.0, line + 1.0])
    >>> fits.degenerate.tolist(), fits.T_target_source[0, :3, 3].round(12).tolist()
    ([False, True], [1.0, 1.0, 1.0])
    """
    points = read_features(points_source, points_target, point_weights, offsets, "points")
    count = points.count
    if (directions_source is None) != (directions_target is None):
        missing = "directions_source" if directions_source is None else "directions_target"
        raise InputError(f"{missing} is missing; give the directions of both sides or of neither")
    directions = None
    if directions_source is not None and directions_target is not None:
        directions = read_features(
            directions_source, directions_target, direction_weights, direction_offsets, "directions"
        )
        if directions.count != count:
            raise InputError(f"points hold {count} problems and directions {directions.count}; give one set a problem")
    elif direction_weights is not None or direction_offsets is not None:
        raise InputError("direction_weights or direction_offsets was given without directions")
    nan = np.full(count, np.nan)
    sums = FitUncertainty(np.zeros((count, 3, 3)), nan.copy(), np.full((count, 3), np.nan), np.ones(count))
    fits = Fits(np.full((count, 4, 4), np.nan), nan, nan.copy(), nan.copy(), np.ones(count, dtype=bool), sums)
    for chosen in _blocks(points, directions):
        _solve_block(chosen, points, directions, fits, sums)
    if absolute_weights:
        return fits
    left = 3 * points.counted() + (0 if directions is None else 2 * directions.counted()) - 6
    variance = np.divide(fits.cost, left, out=np.full(count, np.nan), where=left > 0)
    return replace(fits, uncertainty=replace(sums, variance=variance))


def _blocks(points: FeatureSet, directions: FeatureSet | None) -> list[slice] | list[np.ndarray]:
    """Problems to take together: neighbours where all sizes are equal, else problems of like size."""
    sizes = points.sizes if directions is None else points.sizes + directions.sizes
    if points.is_even and (directions is None or directions.is_even):
        step = max(1, BLOCK_NUMBERS // max(1, int(sizes.max(initial=1))))
        return [slice(i, min(i + step, points.count)) for i in range(0, points.count, step)]
    order = np.argsort(sizes, kind="stable")
    # Blocks hold problems whose sizes agree within a power of two, and no more numbers than fit.
    scale = np.ceil(np.log2(np.maximum(sizes[order], 1))).astype(int)
    blocks = []
    for group in np.split(order, np.flatnonzero(np.diff(scale)) + 1):
        if group.size:
            parts = -(-group.size * int(sizes[group].max(initial=1)) // BLOCK_NUMBERS)
            blocks += np.array_split(group, min(max(parts, 1), group.size))
    return blocks


def _solve_block(
    chosen: slice | np.ndarray, points: FeatureSet, directions: FeatureSet | None, fits: Fits, kept: FitUncertainty
) -> None:
    p, q, beta = points.take(chosen)
    sides = None if directions is None else directions.take(chosen)
    # Lengths whose squares leave float64 make their own problem degenerate, not the others.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        sums = sum_block(p, q, beta, sides)
        # No eigenvalue is more than the reach.
        tame = np.isfinite(sums.H).all(axis=(0, 1)) & np.isfinite(sums.reach) & ~sums.faint
        (lambda_1, lambda_2, lambda_3), r = _eigenvectors(np.where(tame, sums.H, 0.0))
        R = _rotations(r)
        difference = lambda_1 - lambda_2
        floor = sums.floor + SMALLEST_DIFFERENCE * sums.reach
        # lambda_1 + lambda_3 is 2 s2 and lambda_1 + lambda_2 is 2 s1: see `closed_form`.
        narrow = np.flatnonzero((lambda_1 + lambda_3 <= NARROW_RATIO * (lambda_1 + lambda_2)) & tame)
        if narrow.size:
            found = _narrow_rotations(sums, sides, beta, narrow)
            R[:, :, narrow], lambda_1[narrow], difference[narrow], floor[narrow] = found
        good = tame & (sums.weight > 0.0) & (difference > floor)
        gap = np.where(lambda_1 > 0.0, difference / lambda_1, 0.0)
        point_cost, direction_cost = residual_sums(R, sums, beta, sides)
        rms = np.sqrt(point_cost / sums.weight)
    T = np.zeros((*lambda_1.shape, 4, 4))
    T[:, :3, :3] = R.transpose(2, 0, 1)
    T[:, :3, 3] = _translations(R, sums).T
    T[:, 3, 3] = 1.0
    fits.T_target_source[chosen] = np.where(good[:, None, None], T, np.nan)
    fits.cost[chosen] = np.where(good, point_cost + direction_cost, np.nan)
    fits.rms[chosen] = np.where(good, rms, np.nan)
    fits.eigenvalue_gap[chosen] = np.where(sums.weight > 0.0, gap, np.nan)
    fits.degenerate[chosen] = ~good
    kept.H[chosen], kept.centre[chosen] = np.moveaxis(sums.H, -1, 0), sums.mean_target.T
    np.asarray(kept.weight)[chosen] = sums.weight


def _narrow_rotations(
    sums: BatchSums, directions: Sides | None, beta: FloatArray, rows: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rotations (3, 3, r), lambda_1, its gap to lambda_2 and its least value, of narrow problems: see `narrow`."""
    A, B = (np.moveaxis(axes, 0, -1) for axes in long_axes(np.moveaxis(sums.H[:, :, rows], -1, 0)))
    H = np.zeros(A.shape)
    floor, points = SMALLEST_GAP * sums.reach[rows], (sums.p, sums.q, np.where(sums.wide, beta, 0.0))
    for a, b, weights in [points] if directions is None else [points, directions]:
        source, target = (np.einsum("jkr,jir->kir", axes, x[:, :, rows]) for axes, x in ((A, a), (B, b)))
        heavy = weights[:, rows]
        H += np.einsum("iar,jar->ijr", target * heavy, source)
        squares = np.array([(side**2 * heavy).sum(axis=1) for side in (source, target)])
        grains = sums.grains[:, rows] * sums.wide[rows] if a is sums.p else SAME_POINT * np.sqrt(squares.sum(axis=1))
        floor += across_floor(grains, np.sqrt(squares[:, 1:].sum(axis=1)))
    across, turned = H[1, 1] + H[2, 2], H[2, 1] - H[1, 2]
    held = np.hypot(across, turned)
    c, s = np.where(held > 0.0, np.array((across, turned)) / held, [[1.0], [0.0]])
    nothing = np.zeros(len(rows))
    roll = np.array([[nothing + 1.0, nothing, nothing], [nothing, c, -s], [nothing, s, c]])
    return np.einsum("ijr,jkr,lkr->ilr", B, roll, A), H[0, 0] + held, 2.0 * held, floor


def _eigenvectors(H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Largest three eigenvalues (3, c) of each H's `closed_form.quaternion_form`, and vectors (4, c) of the first."""
    # Here, so that who solves one problem at a time never loads Numba.
    from dqreg.kernels.steps.largest_eigenvectors import largest_eigenvectors

    values, vectors = np.zeros((3, H.shape[2])), np.zeros((4, H.shape[2]))
    largest_eigenvectors(0, H.shape[2], as_plain(H), values, vectors)
    return values, vectors


def _rotations(r: FloatArray) -> FloatArray:
    """Rotation matrices (3, 3, b) of unit quaternions (4, b), scalar first."""
    w, x, y, z = r
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _translations(R: FloatArray, sums: BatchSums) -> FloatArray:
    turned = np.einsum("ijb,jb->ib", R - np.eye(3)[:, :, None], sums.mean_source)
    t: FloatArray = (sums.mean_target - sums.mean_source) - turned
    return t
