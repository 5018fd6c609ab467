"""Narrow data: sums in axes along the matches, so that a strip loses the digits that its points lose, and no more.

Let the matches be w times as wide as long. The rotation about their length stands in the sums of products across it,
which are w^2 of the largest. Summed in the axes of the coordinates each entry of H rounds at eps of the largest, so
that rotation is right to eps / w^2 only. Summed in axes along and across the matches, the entries across round at eps
of themselves, because the coordinates across are w of the length, right to eps of it: the rotation about the length
is right to eps / w, which is what the coordinates hold.

With H' in such axes, ``H = B H' A^T``, the rotation is ``B R_x A^T`` with R_x a rotation about the first axis, in
closed form: ``tr(R_x^T H')`` is largest at ``tan(angle) = (H'_32 - H'_23) / (H'_22 + H'_33)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.solvers.rounding import SAME_POINT, across_floor

# Second singular value of H, in units of the first, from which on the matches are not narrow: 7 times as long as wide.
NARROW_RATIO = 2e-2
# Rows taken at once: they stay in the cache.
CHUNK_ROWS = 4096
# Rows and columns of source and target in their products.
SIDES = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """Sums of `Moments` in axes whose first is the length of the matches, on either side."""

    # axes_source, axes_target: (3, 3): Columns A and B, rotations
    axes_source: FloatArray
    axes_target: FloatArray
    # points, directions: (6, 6): Products of the rows (a, b), in those axes: squares of either side and, below, H'
    points: FloatArray
    directions: FloatArray
    grains: FloatArray  # (2,): How far rounding may move the points of either side, see `rounding`

    def turned(self, axes_source: FloatArray, axes_target: FloatArray) -> Aligned:
        """The same in other axes."""
        turn = np.zeros((6, 6))
        turn[:3, :3], turn[3:, 3:] = axes_source.T @ self.axes_source, axes_target.T @ self.axes_target
        points, directions = (turn @ part @ turn.T for part in (self.points, self.directions))
        return Aligned(axes_source, axes_target, points, directions, self.grains)

    def scaled(self, factor: float) -> Aligned:
        """The sums of weights that are ``factor`` times as large."""
        grains = np.sqrt(factor) * self.grains
        return Aligned(self.axes_source, self.axes_target, factor * self.points, factor * self.directions, grains)

    @property
    def reach(self) -> float:
        """The largest lambda_1 that sides of such lengths could have."""
        return float(sum(_lengths(products).prod() for products in (self.points, self.directions)))

    @property
    def is_placed(self) -> bool:
        """Whether the points of neither side lie in one place, as far as rounding can tell."""
        return bool((_lengths(self.points) > self.grains).all())

    def floor(self, *, placed: bool, angle: float = 0.0) -> float:
        """Gap across the length that is none; without the points where they lie in one place.

        The length itself may be known to an angle only, by which the matches reach across it and tell nothing.
        """
        kinds = [(self.directions, SAME_POINT * _lengths(self.directions))]
        if placed:
            kinds.append((self.points, self.grains))
        return sum(
            float(across_floor(grains + angle * _lengths(products), _lengths(products, 1)))
            for products, grains in kinds
        )


def _lengths(products: FloatArray, first: int = 0) -> FloatArray:
    """Roots of the sums of squares of either side, in the axes from the first on. Shapes: (6, 6), returns (2,)."""
    # Rounding may leave less than nothing of what is none.
    return np.sqrt([max(np.trace(products[side, side][first:, first:]), 0.0) for side in SIDES])


def is_narrow(H: FloatArray) -> bool:
    """Whether H is nearly of rank one. Shapes: H (3, 3)."""
    numbers = H.ravel().tolist()
    largest = max(map(abs, numbers))
    if not 0.0 < largest < math.inf:
        return False
    a, b, c, d, e, f, g, h, i = (number / largest for number in numbers)
    # The sum of the squared minors is that of the squared products of two singular values.
    square = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
    minors = (e * i - f * h) ** 2 + (d * i - f * g) ** 2 + (d * h - e * g) ** 2
    minors += (b * i - c * h) ** 2 + (a * i - c * g) ** 2 + (a * h - b * g) ** 2
    minors += (b * f - c * e) ** 2 + (a * f - c * d) ** 2 + (a * e - b * d) ** 2
    return minors <= (NARROW_RATIO * square) ** 2


def long_axes(H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes A and B whose first columns are the singular vectors of the largest singular value.

    Shapes: H (..., 3, 3), returns (..., 3, 3) each.
    """
    U, _, Vt = np.linalg.svd(H)
    A, B = np.swapaxes(Vt, -1, -2).copy(), U.copy()
    for axes in (A, B):
        axes[..., 2] *= np.where(np.linalg.det(axes) < 0.0, -1.0, 1.0)[..., None]
    return A, B


def products_in_axes(
    sides: tuple[FloatArray, FloatArray],
    weights: FloatArray | None,
    origins: tuple[FloatArray, FloatArray],
    axes: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Products of matched rows (a, b) about the origins, in the axes of either side, as `Aligned` has them.

    Shapes: sides (n, 3) each, returns (6, 6).
    """
    total = np.zeros((6, 6))
    for i in range(0, len(sides[0]), CHUNK_ROWS):
        rows = np.hstack([(side[i : i + CHUNK_ROWS] - origins[k]) @ axes[k] for k, side in enumerate(sides)])
        total += (rows if weights is None else rows * weights[i : i + CHUNK_ROWS, None]).T @ rows
    return total


def rotation_of(products: FloatArray, axes: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, float, float]:
    """Best rotation for products in axes A and B, with lambda_1 and its gap to lambda_2, which rounds for itself.

    Shapes: products (6, 6), returns R (3, 3).
    """
    H = products[3:, :3]
    across, turned = float(H[1, 1] + H[2, 2]), float(H[2, 1] - H[1, 2])
    held = math.hypot(across, turned)
    c, s = (across / held, turned / held) if held > 0.0 else (1.0, 0.0)
    R = axes[1] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ axes[0].T
    along = float(H[0, 0])
    return R, along + held, 2.0 * held
