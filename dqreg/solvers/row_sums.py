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
# No normals.
NO_NORMALS = np.zeros((0, 3))


def _together(starts: IntArray, rows: int) -> int:
    """Patches that one thread sums in one go."""
    return max(CHUNK_ROWS * len(starts) // max(rows, 1), 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Patches:
    """Patches of neighbouring rows, each up to the next one."""

    starts: IntArray  # (m,): First row of each
    places: IntArray  # (m,): Which of the patches this is that the sums are over


class PatchSums(Protocol):
    """What the sandwich asks of the rows J of a fit, weights w, residuals r and normals n: of k unknowns, m patches."""

    def information(self) -> FloatArray:
        """Sum of ``w J J^T``, (k, k)."""
        ...

    def over(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
        """Scores ``w J r`` of each patch, (m, k), and its weight, weighted points, normals and residual, (m, 8)."""
        ...

    def pulls(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
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

    def over(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        from dqreg.kernels.evidence.patch_sums import BESIDE, patch_sums
        from dqreg.kernels.threads import as_plain, over_chunks

        starts, many = patches.starts, len(self.rows)
        sums = np.zeros((len(starts), many + BESIDE))
        columns = [as_plain(x) for x in (self.rows, self.points, self.normals, self.residuals, self.weights)]
        over_chunks(patch_sums, len(starts), *columns, starts, sums, chunk=_together(starts, len(self.weights)))
        return sums[:, :many], sums[:, many:]

    def pulls(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        rows, weights, starts = self.rows, self.weights, patches.starts
        along = [np.add.reduceat(rows * (weights * axis), starts, axis=1) for axis in self.normals.T]
        return np.add.reduceat(rows * weights, starts, axis=1).T, np.stack(along).transpose(2, 0, 1)


@dataclasses.dataclass(frozen=True)
class MotionSums:
    """Of distances along normals by the six motions, as `plane_rows` gives them, or by combinations of these.

    They are summed in one pass over patches as small as any that will be asked for, and no row is kept.
    """

    sums: FloatArray  # (g, COLUMNS): See `motion_sums`
    totals: FloatArray  # (TOTALS,): Of all patches
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
        own: FloatArray | None = None,
    ) -> MotionSums:
        """Sums of all rows, with the normals and with those of the smooth surface, which may be the same.

        And with those of the scan, where there are some.
        """
        from dqreg.kernels.evidence.motion_sums import COLUMNS, TOTALS, motion_sums
        from dqreg.kernels.threads import as_plain, over_chunks

        other, chunk = NO_NORMALS if own is None else own, _together(starts, len(weights))
        sums, totals = np.zeros((len(starts), COLUMNS)), np.zeros((-(-len(starts) // chunk), TOTALS))
        columns = map(as_plain, (points, normals, smooth, other, residuals, weights, centre))
        over_chunks(motion_sums, len(starts), *columns, float(lever), starts, chunk, sums, totals, chunk=chunk)
        return MotionSums(sums, totals.sum(axis=0), basis)

    def combined(self, motions: FloatArray) -> MotionSums:
        """The same for combinations of the unknowns, (k, m), one a column."""
        return replaced(self, basis=self.basis @ motions)

    def squares(self) -> float:
        """Sum of ``w r^2``."""
        from dqreg.kernels.evidence.motion_sums import SQUARES

        return float(self.totals[SQUARES])

    def information(self) -> FloatArray:
        """See `PatchSums`."""
        from dqreg.kernels.evidence.motion_sums import PRODUCTS

        found: FloatArray = self.basis.T @ self.totals[PRODUCTS] @ self.basis
        return found

    def of_smooth(self) -> FloatArray:
        """The same with the normals of the smooth surface."""
        from dqreg.kernels.evidence.motion_sums import COLUMNS, PRODUCTS, SMOOTH

        found: FloatArray = self.basis.T @ (self.totals[PRODUCTS] + squared(self.totals[SMOOTH:COLUMNS])) @ self.basis
        return found

    def of_both(self) -> tuple[FloatArray, FloatArray]:
        """Products of what the normals of both sides say, symmetric, and of the target's where the scan has some.

        Shapes: (k, k) each.
        """
        from dqreg.kernels.evidence.motion_sums import ALONE, BOTH, PRODUCTS

        both, alone = squared(self.totals[BOTH:ALONE]), squared(self.totals[ALONE:])
        return self.basis.T @ both @ self.basis, self.basis.T @ (self.totals[PRODUCTS] - alone) @ self.basis

    def over(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        from dqreg.kernels.evidence.motion_sums import OVER

        sums = self._joined(patches, OVER)
        return sums[:, :6] @ self.basis, sums[:, 6:]

    def pulls(self, patches: Patches) -> tuple[FloatArray, FloatArray]:
        """See `PatchSums`."""
        from dqreg.kernels.evidence.motion_sums import PULLS

        found = (self._joined(patches, PULLS).reshape(-1, 6) @ self.basis).reshape(len(patches.places), 4, -1)
        return found[:, 0], found[:, 1:]

    def _joined(self, patches: Patches, columns: IntArray) -> FloatArray:
        """Some of the columns."""
        from dqreg.kernels.evidence.patch_sums import joined_sums

        found = np.zeros((len(patches.places), len(columns)))
        joined_sums(patches.places, self.sums, columns, found)
        return found


# Where the elements of a symmetric matrix stand in its upper triangle, row by row.
_PLACES = np.zeros((6, 6), dtype=np.int64)
_PLACES[np.triu_indices(6)] = np.arange(21)
_PLACES = np.maximum(_PLACES, _PLACES.T)


def squared(triangle: FloatArray) -> FloatArray:
    """Symmetric matrix, (6, 6), from its upper triangle, (21,)."""
    return np.asarray(triangle[_PLACES])
