"""Weighted sums of products over matched rows: one pass in blocks that stay in the cache, by small BLAS products.

A block is 2048 rows because every product then stays below the size at which BLAS wakes its threads, whose
hand-over costs more than the product. Two rows of three numbers are read as one row of six: the 6x6 product of
those costs half of the 3x3 product, whose registers are mostly empty, and its two diagonal blocks add up to it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqreg._arrays import FloatArray

BLOCK_ROWS = 2048
# Blocks that one call of matmul runs through: enough to hide the price of the call, few enough for the cache.
STACK_BLOCKS = 16
# Rows of the block when its vectors are summed by a product with ones.
SUM_ROWS = 64

Pair = tuple[FloatArray, FloatArray]


class FeatureSums(NamedTuple):
    """Sums over matched vectors a (source) and b (target), both about one given origin a side."""

    weight: float  # ``sum w``
    # source, target: (3,): ``sum w a`` and ``sum w b``
    source: FloatArray
    target: FloatArray
    cross: FloatArray  # (3, 3): ``sum w b a^T``
    # square_source, square_target: ``sum w |a|^2`` and ``sum w |b|^2``
    square_source: float
    square_target: float


def feature_sums(
    source: FloatArray,
    target: FloatArray,
    weights: FloatArray | None = None,
    origin: Pair | None = None,
    *,
    products_only: bool = False,
) -> FeatureSums:
    """Sum over all rows."""
    whole = len(source) // BLOCK_ROWS * BLOCK_ROWS
    if not whole:
        return _sums_of_few(source, target, weights, origin)
    head = _sums_of_blocks(
        (source[:whole], target[:whole]), None if weights is None else weights[:whole], origin, products_only
    )
    if whole == len(source):
        return head
    tail = _sums_of_few(source[whole:], target[whole:], None if weights is None else weights[whole:], origin)
    return FeatureSums(
        head.weight + tail.weight,
        head.source + tail.source,
        head.target + tail.target,
        head.cross + tail.cross,
        head.square_source + tail.square_source,
        head.square_target + tail.square_target,
    )


def _sums_of_few(
    source: FloatArray, target: FloatArray, weights: FloatArray | None, origin: Pair | None
) -> FeatureSums:
    if origin is not None:
        source, target = source - origin[0], target - origin[1]
    if weights is None:
        weights = np.ones(len(source))
        heavy_source, heavy_target = source, target
    else:
        heavy_source, heavy_target = source * weights[:, None], target * weights[:, None]
    return FeatureSums(
        float(weights.sum()),
        weights @ source,
        weights @ target,
        heavy_target.T @ source,
        float(np.dot(heavy_source.ravel(), source.ravel())),
        float(np.dot(heavy_target.ravel(), target.ravel())),
    )


def _sums_of_blocks(rows: Pair, weights: FloatArray | None, origin: Pair | None, products_only: bool) -> FeatureSums:
    count = len(rows[0]) // BLOCK_ROWS
    source, target = (side.reshape(count, 3 * BLOCK_ROWS) for side in rows)
    by_block = None if weights is None else weights.reshape(count, BLOCK_ROWS)
    shift = None if origin is None else np.tile(np.stack(origin), BLOCK_ROWS)
    shape = min(STACK_BLOCKS, count), 3 * BLOCK_ROWS
    moved, weighed = np.zeros((2, *shape)), np.zeros((3, *shape))
    cross, squares = np.zeros((count, 6, 6)), np.zeros((2, count, 1, 1))
    sums, ones = np.zeros((2, count, 3 * BLOCK_ROWS // SUM_ROWS)), np.ones(SUM_ROWS)
    for first in range(0, count, STACK_BLOCKS):
        here = slice(first, min(first + STACK_BLOCKS, count))
        pair = (source[here], target[here])
        k = len(pair[0])
        if shift is not None:
            pair = tuple(np.subtract(pair[side], shift[side], out=moved[side, :k]) for side in (0, 1))
        heavy = pair if by_block is None else _weigh(pair, by_block[here], weighed[:, :k])
        np.matmul(heavy[1].reshape(k, -1, 6).transpose(0, 2, 1), pair[0].reshape(k, -1, 6), out=cross[here])
        for side in (0, 1):
            np.matmul(pair[side][:, None, :], heavy[side][:, :, None], out=squares[side, here])
            if not products_only:
                np.matmul(ones, heavy[side].reshape(k, SUM_ROWS, -1), out=sums[side, here])
    two = cross.sum(axis=0).reshape(2, 3, 2, 3)
    of_source, of_target = sums.sum(axis=1).reshape(2, -1, 3).sum(axis=1)
    weight = float(len(rows[0])) if weights is None else float(weights.sum())
    square_source, square_target = squares.sum(axis=(1, 2, 3)).tolist()
    return FeatureSums(weight, of_source, of_target, two[0, :, 0] + two[1, :, 1], square_source, square_target)


def _weigh(pair: Pair, weights: FloatArray, out: FloatArray) -> Pair:
    # Each weight is written three times in a row: flat products are far cheaper than rows of three times one.
    thrice = out[2].reshape(*weights.shape, 3)
    for axis in range(3):
        thrice[:, :, axis] = weights
    return np.multiply(pair[0], out[2], out=out[0]), np.multiply(pair[1], out[2], out=out[1])
