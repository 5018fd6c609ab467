"""Matched vectors of many problems, checked at the door and laid out for sums over whole blocks of problems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqreg._arrays import FloatArray, IntArray, as_float, as_vectors, as_weights, require_finite
from dqreg.errors import InputError
from dqreg.solvers.matches import refuse_zero_directions

Sides = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class FeatureSet:
    """Matched vectors of b problems, all rows below each other."""

    # source, target: (total, 3): Matched vectors
    source: FloatArray
    target: FloatArray
    weights: FloatArray  # (total,): One weight a row
    # starts, sizes: (b,): First row and number of rows of each problem
    starts: IntArray
    sizes: IntArray
    is_even: bool  # Whether all problems have the same number of rows

    @property
    def count(self) -> int:
        """Number of problems."""
        return len(self.sizes)

    def counted(self) -> IntArray:
        """Rows that carry weight, of each problem, (b,)."""
        edges = np.concatenate([[0], np.cumsum(self.weights > 0.0)])
        counts: IntArray = edges[self.starts + self.sizes] - edges[self.starts]
        return counts

    def take(self, chosen: slice | NDArray[np.intp]) -> Sides:
        """Some problems with the problem as the last axis, short ones filled up with rows of weight zero.

        Shapes: source, target (3, k, c), weights (k, c).
        """
        starts, sizes = self.starts[chosen], self.sizes[chosen]
        if self.is_even and isinstance(chosen, slice):
            k = int(sizes[0]) if len(sizes) else 0
            rows = slice(chosen.start * k, chosen.stop * k)
            source, target = (
                np.ascontiguousarray(side[rows].reshape(len(sizes), k, 3).transpose(2, 1, 0))
                for side in (self.source, self.target)
            )
            return source, target, np.ascontiguousarray(self.weights[rows].reshape(len(sizes), k).T)
        step = np.arange(int(sizes.max(initial=0)))[:, None]
        held = step < sizes
        # Filled rows repeat the problem's first one at weight zero, so they cannot widen anything.
        index = np.where(held, starts + step, np.minimum(starts, max(len(self.source) - 1, 0)))
        source, target = (np.moveaxis(side[index], 2, 0) for side in (self.source, self.target))
        return source, target, np.where(held, self.weights[index], 0.0)


def read_features(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None, offsets: ArrayLike | None, kind: str
) -> FeatureSet:
    """Check one kind of matched vectors of many problems.

    Shapes: source, target (b, n, 3), weights (b, n), offsets (b + 1,).

    >>> read_features(np.zeros((2, 3, 3)), np.zeros((2, 3, 3)), None, None, "points").starts.tolist()
    [0, 3]
    """
    sides = [as_float(side, f"{kind}_{name}") for side, name in ((source, "source"), (target, "target"))]
    if sides[0].shape != sides[1].shape:
        raise InputError(f"{kind}_source has shape {sides[0].shape} and {kind}_target {sides[1].shape}; give the same")
    if offsets is None:
        if sides[0].ndim != 3 or sides[0].shape[2] != 3:
            raise InputError(
                f"{kind}_source must have shape (b, n, 3), or (total, 3) with offsets; got shape {sides[0].shape}"
            )
        count, size = sides[0].shape[:2]
        starts, sizes = np.arange(count, dtype=np.int64) * size, np.full(count, size, dtype=np.int64)
    else:
        starts, sizes = _read_offsets(offsets, sides[0], kind)
    rows = [as_vectors(side.reshape(-1, 3), f"{kind}_source") for side in sides]
    flat = _read_weights(weights, sides[0].shape[:-1], kind)
    if kind == "directions":
        refuse_zero_directions(rows[0], "directions_source", flat)
        refuse_zero_directions(rows[1], "directions_target", flat)
    return FeatureSet(rows[0], rows[1], flat, starts, sizes, offsets is None)


def _read_weights(weights: ArrayLike | None, shape: tuple[int, ...], kind: str) -> FloatArray:
    total = int(np.prod(shape))
    if weights is None:
        return np.ones(total)
    name = f"{kind.removesuffix('s')}_weights"
    array = as_float(weights, name)
    if (array == np.inf).any():
        raise InputError(
            f"{name} holds {np.count_nonzero(array == np.inf)} infinite weights; exact matches are solved one problem "
            "at a time, by dqreg.solve"
        )
    if array.ndim and array.shape != shape:
        raise InputError(f"{name} must be one number or have shape {shape}; got shape {array.shape}")
    return as_weights(array if not array.ndim else array.ravel(), name, total)


def _read_offsets(offsets: ArrayLike, rows: FloatArray, kind: str) -> tuple[IntArray, IntArray]:
    name = "offsets" if kind == "points" else "direction_offsets"
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{kind}_source must have shape (total, 3) with {name}; got shape {rows.shape}")
    array = as_float(offsets, name)
    require_finite(array, name)
    if array.ndim != 1 or not array.size or (array != np.floor(array)).any():
        raise InputError(f"{name} must be b + 1 whole numbers; got shape {array.shape}")
    if array[0] != 0 or array[-1] != len(rows) or (np.diff(array) < 0).any():
        raise InputError(
            f"{name} must rise from 0 to the number of rows, {len(rows)}; "
            f"got {array[0]:g} to {array[-1]:g}, smallest step {np.diff(array).min(initial=0):g}"
        )
    edges = array.astype(np.int64)
    return edges[:-1], np.diff(edges)
