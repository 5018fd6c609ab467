"""Sums over patches of neighbouring rows of a least-squares fit: of any rows, and of those of the six motions."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np

from dqreg._arrays import FloatArray, IntArray, product
from dqreg._records import replaced

# Information below this fraction of what all correspondences could give with the longest lever is rounding or facets,
# not shape.
FREE_SHARE = 1e-5
# Rows that one thread sums in one go, about.
CHUNK_ROWS = 8_192


def _together(starts: IntArray, rows: int) -> int:
    """Patches that one thread sums in one go."""
    return max(CHUNK_ROWS * len(starts) // max(rows, 1), 1)


class PatchSums(Protocol):
    """What the sandwich asks of the rows J of a fit, weights w, residuals r and normals n: of k unknowns, m patches."""

    def information(self) -> FloatArray:
        """Sum of ``w J J^T``, (k, k)."""
        ...

    def over(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """Scores ``w J r`` of each patch, (m, k), and its weight, weighted points, normals and residual, (m, 8)."""
        ...

    def pulls(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """Sums of ``w J`` of each patch, (m, k), and of ``w J n``, along each axis, (m, 3, k)."""
        ...


@dataclasses.dataclass(frozen=True)
class RowSums:
    """Of rows that are kept, (k, n)."""

    rows: FloatArray  # (k, n)
    points: FloatArray  # (n, 3)
    normals: FloatArray  # (n, 3)
    residuals: FloatArray  # (n,)
    weights: FloatArray  # (n,)

    def information(self) -> FloatArray:
        """See `PatchSums`."""
        return product(self.rows * self.weights, self.rows.T)

    def over(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        from dqreg.kernels.patch_sums import BESIDE, patch_sums
        from dqreg.kernels.threads import as_plain, over_chunks

        many = len(self.rows)
        sums = np.zeros((len(starts), many + BESIDE))
        columns = [as_plain(x) for x in (self.rows, self.points, self.normals, self.residuals, self.weights)]
        over_chunks(patch_sums, len(starts), *columns, starts, sums, chunk=_together(starts, len(self.weights)))
        return sums[:, :many], sums[:, many:]

    def pulls(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        rows, weights = self.rows, self.weights
        along = [np.add.reduceat(rows * (weights * axis), starts, axis=1) for axis in self.normals.T]
        return np.add.reduceat(rows * weights, starts, axis=1).T, np.stack(along).transpose(2, 0, 1)


@dataclasses.dataclass(frozen=True)
class MotionSums:
    """Of distances along normals by the six motions, as `plane_rows` gives them, or by combinations of these.

    They are summed in one pass over patches as small as any that will be asked for, and no row is kept.
    """

    starts: IntArray  # (g,): First row of each patch
    sums: FloatArray  # (g, COLUMNS): See `motion_sums`
    totals: FloatArray  # (COLUMNS,): Of all patches
    basis: FloatArray  # (6, k): The unknowns, one a column

    @staticmethod
    def of(
        points: FloatArray,
        normals: FloatArray,
        smooth: FloatArray,
        residuals: FloatArray,
        weights: FloatArray,
        centre: FloatArray,
        lever: float,
        starts: IntArray,
        basis: FloatArray,
    ) -> MotionSums:
        """Sums of all rows, with the normals and with those of the smooth surface, which may be the same."""
        from dqreg.kernels.motion_sums import COLUMNS, motion_sums
        from dqreg.kernels.threads import as_plain, over_chunks

        sums = np.zeros((len(starts), COLUMNS))
        columns = [as_plain(x) for x in (points, normals, smooth, residuals, weights, centre)]
        chunk = _together(starts, len(weights))
        over_chunks(motion_sums, len(starts), *columns, float(lever), starts, sums, chunk=chunk)
        return MotionSums(starts, sums, np.ones(len(starts)) @ sums, basis)

    def combined(self, motions: FloatArray) -> MotionSums:
        """The same for combinations of the unknowns, (k, m), one a column."""
        return replaced(self, basis=self.basis @ motions)

    def squares(self) -> float:
        """Sum of ``w r^2``."""
        from dqreg.kernels.motion_sums import SQUARES

        return float(self.totals[SQUARES])

    def information(self) -> FloatArray:
        """See `PatchSums`."""
        from dqreg.kernels.motion_sums import PRODUCTS

        found: FloatArray = self.basis.T @ self.totals[PRODUCTS] @ self.basis
        return found

    def of_smooth(self) -> FloatArray:
        """The same with the normals of the smooth surface."""
        from dqreg.kernels.motion_sums import PRODUCTS, SMOOTH

        found: FloatArray = self.basis.T @ (self.totals[PRODUCTS] + squared(self.totals[SMOOTH:])) @ self.basis
        return found

    def over(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`; each start is one of this one's."""
        from dqreg.kernels.motion_sums import OVER

        sums = self._joined(starts, OVER)
        return sums[:, :6] @ self.basis, sums[:, 6:]

    def pulls(self, starts: IntArray) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`; each start is one of this one's."""
        from dqreg.kernels.motion_sums import PULLS

        found = (self._joined(starts, PULLS).reshape(-1, 6) @ self.basis).reshape(len(starts), 4, -1)
        return found[:, 0], found[:, 1:]

    def _joined(self, starts: IntArray, columns: IntArray) -> FloatArray:
        """Some of the columns, of patches with those starts."""
        from dqreg.kernels.patch_sums import joined_sums

        found = np.zeros((len(starts), len(columns)))
        joined_sums(np.searchsorted(self.starts, starts), self.sums, columns, found)
        return found


# Where the elements of a symmetric matrix stand in its upper triangle, row by row.
_PLACES = np.zeros((6, 6), dtype=np.int64)
_PLACES[np.triu_indices(6)] = np.arange(21)
_PLACES = np.maximum(_PLACES, _PLACES.T)


def squared(triangle: FloatArray) -> FloatArray:
    """Symmetric matrix, (6, 6), from its upper triangle, (21,)."""
    return np.asarray(triangle[_PLACES])
