"""The planes that one scan puts into the joint cost: its points on the tangent planes of another."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Closest, Scan, Surface
from dqreg.icp import Correspondences
from dqreg.icp.estimators import FEWEST_PLANES, both_planes
from dqreg.icp.rejectors import boundary_rejectors
from dqreg.multiway.overlap import cell_numbers
from dqreg.rigid import pose
from dqreg.solvers.quadratic import QuadraticForm, plane_form
from dqreg.solvers.robust import InlierMixture

# Normals farther apart than this are of different faces; the second is for a look at what hangs on the first.
FACING, STRICT = float(np.cos(np.deg2rad(45.0))), float(np.cos(np.deg2rad(15.0)))
# Distances along the normals below this fraction of the spacing: the planes alone count then. Discs, which hold a
# little along the surface too, suit noisy clouds; here they would drag the poses towards the nearest points.
WELL_BELOW = 0.4
# Fraction of the information in one cell that is believed at most.
MOST_LEVERAGE = 0.9
# Rounds that fit the scale of the distances.
ROUNDS = 20


@dataclasses.dataclass(frozen=True)
class Planes:
    """Correspondences of one pair at one pose."""

    target: int  # Node whose planes count
    source: int  # Node whose points count
    pairs: Correspondences  # Between the centred frames
    weights: FloatArray  # (n,): Probabilities to be an inlier
    sigma: float  # Standard deviation of the distances along the normals

    @property
    def count(self) -> float:
        """Inliers."""
        return float(self.weights.sum())

    @property
    def form(self) -> QuadraticForm:
        """The cost in units of the variance of the distances, between the centred frames."""
        pairs, kept = self.pairs, self.weights > 0.0
        if pairs.closest.variances is not None and self.sigma > WELL_BELOW * pairs.scan.spacing:
            form = both_planes(pairs, self.weights)
        else:
            p, q, n = pairs.scan.points[kept], pairs.closest.points[kept], pairs.closest.normals[kept]
            w = self.weights[kept]
            origins = (w @ p / w.sum(), w @ q / w.sum())
            form = QuadraticForm(plane_form(p, q, n, w, origins), *origins)
        return dataclasses.replace(form, matrix=form.matrix / self.sigma**2)

    def scores(self, T_world_target: FloatArray, cell: float) -> tuple[IntArray, FloatArray]:
        """Numbers of the cells of the world that hold points, and the slope of the cost by world increments of each.

        Shapes: cells (k,), slopes (k, 6).
        """
        kept = np.flatnonzero(self.weights > 0.0)
        x, n = self.pairs.moved[kept], self.pairs.closest.normals[kept]
        along = self.pairs.point_to_plane[kept] * self.weights[kept] / self.sigma**2
        x, n = pose.apply(T_world_target, x), n @ T_world_target[:3, :3].T
        rows = np.hstack([np.cross(x, n), n])
        cells, group = np.unique(cell_numbers(x, cell), return_inverse=True)
        slopes: FloatArray = np.column_stack([np.bincount(group, column * along, len(cells)) for column in rows.T])
        leverage = _leverage(rows * np.sqrt(self.weights[kept])[:, None], group, len(cells))
        return cells, slopes / (1.0 - np.minimum(leverage, MOST_LEVERAGE))[:, None]


def _leverage(rows: FloatArray, group: IntArray, cells: int) -> FloatArray:
    """Largest fraction of the information about any motion that each cell holds by itself, (cells,).

    A cell that alone holds a motion has residuals of zero there, whatever its error: the jackknife divides by what the
    others leave open (MacKinnon and White 1985).
    """
    total = rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(total / scale / scale[:, None])
    whitened = (rows / scale) @ (vectors / np.sqrt(np.maximum(values, 1e-12)))
    # The trace bounds the largest eigenvalue, and is it where one motion hangs on the cell.
    return np.minimum(np.bincount(group, (whitened**2).sum(axis=1), cells), 1.0)


def _sureness(pairs: Correspondences, sigma: float) -> FloatArray:
    """Share of the variance of each distance that is not due to the tilt of its plane, (n,).

    A plane that is tilted by a little errs by so much of the way from its point to the foot: fits across an edge do.
    """
    variances = pairs.closest.variances
    if variances is None:
        return np.ones(len(pairs.distances))
    along = np.maximum(pairs.distances**2 - pairs.point_to_plane**2, 0.0)
    return np.asarray(sigma**2 / (sigma**2 + variances * along))


def planes_of(
    nodes: tuple[int, int],
    scan: Scan,
    surface: Surface,
    T_target_source: FloatArray,
    reach: float,
    floor: float,
    before: Planes | None = None,
    facing: float = FACING,
) -> Planes | None:
    """Correspondences within reach, robustly weighed; None where there are too few.

    Poses are between the centred frames. The scale of the distances is that of this pair: scans differ in noise.
    """
    hint: tuple[FloatArray, Closest] | None = None
    if before is not None and before.pairs.scan is scan:
        hint = before.pairs.moved, before.pairs.closest
    moved = pose.apply(T_target_source, scan.points)
    pairs = Correspondences(scan, T_target_source, surface.closest(moved, hint), scan.oriented and surface.oriented)
    cosines = pairs.normal_cosines if pairs.same_sign else np.abs(pairs.normal_cosines)
    kept = (pairs.distances <= reach) & (cosines >= facing)
    for rejects in boundary_rejectors(surface, reach):
        kept &= rejects(pairs) > 0.0
    if np.count_nonzero(kept) < FEWEST_PLANES:
        return None
    aside = np.abs(pairs.point_to_plane)
    mixture = InlierMixture.widest(reach, floor).fit(aside[kept], floor=floor, rounds=ROUNDS)
    weights = np.where(kept, mixture.weight(aside), 0.0) * _sureness(pairs, mixture.scale)
    # Below a millionth the weight is rounding.
    weights[weights < 1e-6] = 0.0
    found = Planes(*nodes, pairs, weights, mixture.scale)
    return found if found.count >= FEWEST_PLANES else None
