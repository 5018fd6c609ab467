"""The planes that one scan puts into the joint cost: its points on the tangent planes of another."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import CloudSurface, Scan, Surface
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
# Residuals of a fitted plane beyond which it goes across an edge: in typical ones of its scan, and in spacings, which
# allows for what a round surface bends by between neighbours.
FIRM, SMOOTH = 2.0, 0.1
# How near edges and rims hold what no face holds, in spacings.
LOCKED = 0.5
# Rounds that fit the scale of the distances.
ROUNDS = 20


@dataclasses.dataclass(frozen=True)
class Body:
    """A node of the joint cost: a scan that moves, or the part."""

    scan: Scan | None  # Its points; None for the part, which has planes only
    surface: Surface  # What the points of others are compared with
    origin: FloatArray  # (3,): Origin of the centred frame in its own

    @cached_property
    def roughness(self) -> FloatArray | None:
        """Residual of the plane around each point as it was given, (n,); None for the part, whose planes are exact."""
        if self.scan is None or not isinstance(self.surface, CloudSurface):
            return None
        rough = np.full(int(self.surface.order.max()) + 1, np.inf)
        rough[self.surface.order] = np.nan_to_num(self.scan.residuals, nan=np.inf)
        return rough

    @property
    def noise_floor(self) -> float:
        """Scale of distances that cannot be real."""
        return 1e-7 * self.surface.diagonal if self.scan is None else 1e-3 * self.scan.spacing


@dataclasses.dataclass(frozen=True)
class Planes:
    """Correspondences of one pair at one pose."""

    target: int  # Node whose planes count
    source: int  # Node whose points count
    pairs: Correspondences  # Between the centred frames
    weights: FloatArray  # (n,): Probabilities to be an inlier
    sigma: float  # Standard deviation of the distances along the normals
    firm: BoolArray  # (n,): On one face on either side, as far as the points around tell

    @property
    def count(self) -> float:
        """Inliers."""
        return float(self.weights.sum())

    @cached_property
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

    @property
    def on_faces(self) -> Planes:
        """Those alone whose planes are those of faces: fits across an edge are tilted by what lies around them."""
        return dataclasses.replace(self, weights=np.where(self.firm, self.weights, 0.0))

    @property
    def locked(self) -> FloatArray:
        """Information about the target's origin if all that is matched were placed to half a spacing, (6, 6).

        So near do edges and rims hold whatever slides along the faces: their points come to lie between those of the
        other scan, wherever these happen to be.
        """
        kept = np.flatnonzero(self.weights > 0.0)
        spread = _arms(self.pairs.moved[kept])
        weights = self.weights[kept] / self.weights[kept].sum()
        return np.asarray(np.einsum("k,kij,klj->il", weights, spread, spread) / (LOCKED * self.pairs.scan.spacing) ** 2)

    @property
    def apparent(self) -> FloatArray:
        """Part of the information that is due to errors of the normals alone, about the target's origin, (6, 6).

        A plane tilted by an error e has the row ``(x, n + e)``: its square holds ``E[e e^T]`` too, as if the plane held
        motions along itself. It does not: errors in variables.
        """
        variances = self.pairs.closest.variances
        if variances is None or self.sigma > WELL_BELOW * self.pairs.scan.spacing:
            return np.zeros((6, 6))
        kept = np.flatnonzero(self.weights > 0.0)
        n = self.pairs.closest.normals[kept]
        # A normal's variance is the sum over two tangential axes.
        share = 0.5 * self.weights[kept] * np.minimum(variances[kept], 1.0) / self.sigma**2
        rows = _arms(self.pairs.moved[kept])
        along = rows - np.einsum("kij,kj->ki", rows, n)[:, :, None] * n[:, None]
        return np.asarray(np.einsum("k,kij,klj->il", share, along, along))

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


def _arms(points: FloatArray) -> FloatArray:
    """What a twist about the origin does to points, transposed, (n, 6, 3)."""
    x, y, z = points.T
    o = np.zeros(len(points))
    turns = np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)
    return np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=1)


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


def _firm(pairs: Correspondences, target: Body) -> BoolArray:
    firm = pairs.scan.residuals <= _rough(pairs.scan)
    if target.roughness is not None and target.scan is not None:
        firm &= target.roughness[pairs.closest.elements] <= _rough(target.scan)
    return np.asarray(firm)


def _rough(scan: Scan) -> float:
    """Residual of a fitted plane beyond which it goes across an edge."""
    return max(FIRM * scan.noise, SMOOTH * scan.spacing)


def planes_of(
    nodes: tuple[int, int],
    scan: Scan,
    target: Body,
    T_target_source: FloatArray,
    reach: float,
    floor: float,
    before: Planes | None = None,
    facing: float = FACING,
) -> Planes | None:
    """Correspondences within reach, robustly weighed; None where there are too few.

    Poses are between the centred frames. The scale of the distances is that of this pair: scans differ in noise.
    """
    surface, hint = target.surface, None
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
    found = Planes(*nodes, pairs, weights, mixture.scale, _firm(pairs, target))
    return found if found.count >= FEWEST_PLANES else None
