"""A scan as the loop takes it: points in Morton order with their planes, spacing and noise."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg._records import made_of, made_once, one_line, remembered
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, ScanPlanes, fit_planes_at, sample_rows
from dqreg.geometry.spacing import Spread
from dqreg.geometry.vector_rows import nonzero_rows

# What planes tell of points, and what some of these have in common with all.
COLUMNS = "normals", "levers", "residuals"
OF_ALL = "oriented", "spacing", "noise", "total", "quiet"
# Planes that leave more of their lever's length lie across an edge: half and half of a right angle it is 0.5.
MAX_FLAT_RESIDUAL = 0.45


@dataclasses.dataclass(frozen=True)
class Scan:
    """Source points ready for the loop, in Morton order.

    Attributes
    ----------
    points : ndarray, (n, 3)
        In the source frame.
    normals : ndarray, (n, 3)
        Unit normals; zero where none is known. The sign counts only if ``oriented``.
    levers : ndarray, (n,)
        Weight of each normal relative to its point, a squared length (see `PlaneFits`); 0 where none was fitted.
    residuals : ndarray, (n,)
        Local plane residual sigma_r of each point; NaN where unknown.
    oriented : bool
        Whether the normals' signs are known (given, or a viewpoint was).
    spacing : float
        Median distance between nearest neighbours of the whole cloud.
    noise : float
        Median local plane residual: an upper estimate of the point noise where the surface is curved.
    total : int
        Distinct points of the whole cloud.
    fitted : ndarray of int, (m,), or None
        Rows at which planes were fitted, ascending; None stands for all.
    counts : ndarray, (n,), or None
        Points of one face that each row stands for, as their mean; None where every row is a point.
    within : ndarray, (n,), or None
        Within-face scatter: sum of the squared distances of those points from their mean, along the normal.
    quiet : float, or None
        Noise of the quieter faces, from local quadrics: no curvature of a sparse scan is in it; None for a cloud.
    parts : ndarray of uint8, (n,), or None
        Which of up to eight parts of the cloud, in its own order, each point stands in (views of a scan follow each
        other); eight for the mean of points of several.

    Examples
    --------
    >>> from dqreg.geometry import PointCloud, prepare_scan
    >>> scan = prepare_scan(PointCloud(np.random.default_rng(0).uniform(size=(400, 3)) * [1, 1, 0]))
    >>> len(scan), len(scan.thinned(100)), scan.taken(scan.even_rows(10)).total, scan.noise < 1e-12
    (400, 100, 400, True)
    """

    __repr__ = one_line
    points: FloatArray
    normals: FloatArray
    levers: FloatArray
    residuals: FloatArray
    oriented: bool
    spacing: float
    noise: float
    total: int
    fitted: IntArray | None = None
    counts: FloatArray | None = None
    within: FloatArray | None = None
    quiet: float | None = None
    parts: NDArray[np.uint8] | None = None

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> FloatArray:
            # Where planes were fitted at few of many points, nobody asks for those of all, as a rule.
            if name not in COLUMNS or remembered(self, "_planes") is None:
                raise AttributeError(name)
            return made_once(self, name, lambda: self._planes.whole(name))

    @staticmethod
    def _with(planes: ScanPlanes, fields: dict[str, Any]) -> Scan:
        """A scan of its other fields and of planes at some of its points."""
        if len(planes.rows) == planes.total:
            return Scan(normals=planes.normals, levers=planes.levers, residuals=planes.residuals, **fields)
        return made_of(Scan, {**fields, "fitted": planes.rows, "_planes": planes})

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, count: int) -> Scan:
        """The same scan with fewer points, evenly taken along the Morton curve; itself where it has no more.

        Parameters
        ----------
        count : int
            Points at most; where the rows with fitted planes suffice, they are taken.

        Returns
        -------
        Scan
        """
        return self if count >= len(self) else self.taken(self.even_rows(count))

    def even_rows(self, count: int) -> IntArray:
        """Rows that `thinned` takes, ascending.

        Parameters
        ----------
        count : int
            Points at most.

        Returns
        -------
        ndarray of int
        """
        if self.fitted is not None and count <= len(self.fitted):
            return self.fitted if count == len(self.fitted) else self.fitted[sample_rows(len(self.fitted), count)]
        return sample_rows(len(self), count)

    def taken(self, rows: IntArray) -> Scan:
        """Some of its rows alone, with the spacing, noise and total of the whole scan.

        Parameters
        ----------
        rows : ndarray of int
            Which, ascending.

        Returns
        -------
        Scan
        """
        points, parts = np.take(self.points, rows, axis=0), None if self.parts is None else self.parts[rows]
        if (planes := remembered(self, "_planes")) is not None:
            some, of_all = planes.at(rows), {name: getattr(self, name) for name in OF_ALL}
            return Scan._with(some, {**of_all, "points": points, "parts": parts, "fitted": some.rows})
        normals, levers, residuals = np.take(self.normals, rows, axis=0), self.levers[rows], self.residuals[rows]
        fitted = None
        if self.fitted is not None:
            has_plane = np.zeros(len(self), dtype=bool)
            has_plane[self.fitted] = True
            fitted = np.flatnonzero(has_plane[rows])
        columns: dict[str, Any] = {"normals": normals, "levers": levers, "residuals": residuals, "parts": parts}
        return dataclasses.replace(self, points=points, fitted=fitted, **columns)

    @property
    def _fitted_planes(self) -> tuple[IntArray | slice, FloatArray, FloatArray, FloatArray]:
        """Rows at which planes were fitted, and the normals, levers and residuals of these alone."""
        known = remembered(self, "_planes")
        if known is not None:
            return known.rows, known.normals, known.levers, known.residuals
        rows = slice(None) if self.fitted is None else self.fitted
        return rows, self.normals[rows], self.levers[rows], self.residuals[rows]

    @property
    def represented(self) -> float:
        """Points that all rows stand for."""
        return float(len(self) if self.counts is None else self.counts.sum())

    @cached_property
    def scatter(self) -> FloatArray | float:
        """Mean squared distance, along the normal, of the points of each row from the row: zero where it is a point."""
        return 0.0 if self.counts is None or self.within is None else self.within / self.counts

    @cached_property
    def _variances(self) -> FloatArray:
        """Variance of each normal by its fit, rad^2, (n,): 0 where it was given, 1 at most."""
        from dqreg.kernels.clouds.fitted_normals import variances_of_normals

        return variances_of_normals(self.residuals, self.levers, NORMAL_NEIGHBOURS)

    @cached_property
    def directed(self) -> BoolArray:
        """Which points have a normal, (n,)."""
        return nonzero_rows(self.normals)

    @cached_property
    def _rejecting_normals(self) -> FloatArray:
        """Normals that may reject a correspondence, (n, 3): those that were given, or of planes on one face."""
        from dqreg.kernels.clouds.fitted_normals import rough_planes

        fits = remembered(self, "_planes", self)
        rough, count = rough_planes(fits.residuals, fits.levers, MAX_FLAT_RESIDUAL)
        # Of a denser scan few are, and what they reject at the edges of two views is no overlap as a rule.
        if self.oriented or 2 * len(rough) <= count:
            return self.normals
        normals = self.normals.copy()
        normals[rough if fits is self else fits.rows[rough]] = 0.0
        return normals

    @cached_property
    def tree(self) -> NeighbourTree:
        """Tree of the points: distances between them are the same at any pose; for fewer queries than points."""
        return NeighbourTree(self.points, in_order=True)

    @cached_property
    def _spread(self) -> Spread:
        """Mean and second moment of the points."""
        return Spread.of(self.points)

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box."""
        low, high = bounds(self.points)
        return float(np.linalg.norm(high - low))


def with_planes(scan: Scan, count: int) -> Scan:
    """A scan with planes fitted at more rows, without signs; as it is where enough of them are."""
    if scan.fitted is None or min(count, len(scan)) <= len(scan.fitted):
        return scan
    rows = sample_rows(len(scan), count)
    planes = ScanPlanes.of(rows, fit_planes_at(scan.tree, scan.points, rows), len(scan))
    others = [field.name for field in dataclasses.fields(scan) if field.name not in COLUMNS]
    return Scan._with(planes, {**{name: getattr(scan, name) for name in others}, "fitted": None})
