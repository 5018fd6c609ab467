"""Planes fitted at some points of a scan: kept for these, and written out for all where all are asked about."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.normals import PlaneFits, orient_towards


@dataclasses.dataclass(frozen=True)
class ScanPlanes:
    """Planes at m of so many points."""

    rows: IntArray  # (m,): Those points, ascending
    normals: FloatArray  # (m, 3): Zero where there is no plane
    levers: FloatArray  # (m,): Zero where there is no plane
    residuals: FloatArray  # (m,)
    total: int  # Points

    @staticmethod
    def of(rows: IntArray, fits: PlaneFits, total: int) -> ScanPlanes:
        """Planes as they were fitted."""
        known = fits.known
        normals, levers = np.where(known[:, None], fits.normals, 0.0), np.where(known, fits.lever, 0.0)
        return ScanPlanes(rows, normals, levers, fits.residuals.copy(), total)

    def oriented(self, points: FloatArray, viewpoint: FloatArray) -> ScanPlanes:
        """The same with normals that face a viewpoint, of all points."""
        return dataclasses.replace(self, normals=orient_towards(self.normals, points[self.rows], viewpoint))

    def at(self, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Normals, levers and residuals of some rows, ascending, and which of them have planes."""
        places = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        fitted = np.flatnonzero(self.rows[places] == rows)
        return *ScanPlanes(fitted, *self._columns(places[fitted]), len(rows)).whole(), fitted

    def whole(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normals, levers and residuals of all points: those without a plane have zeros, and NaN."""
        normals, levers = np.zeros((self.total, 3)), np.zeros(self.total)
        residuals = np.full(self.total, np.nan)
        normals[self.rows], levers[self.rows], residuals[self.rows] = self.normals, self.levers, self.residuals
        return normals, levers, residuals

    def _columns(self, places: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return np.take(self.normals, places, axis=0), self.levers[places], self.residuals[places]
