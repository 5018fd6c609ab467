"""The planes that one scan puts into the joint cost: its points on the tangent planes of another."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.icp.estimators import BEND_VARIANCE, MIN_PLANES, plane_to_plane_form
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.matches import BodyMatches
from dqreg.multiway.scans.overlap import cell_numbers
from dqreg.rigid import pose
from dqreg.solvers.quadratic import QuadraticForm, plane_form
from dqreg.solvers.robust import InlierMixture

# Distances along the normals below this fraction of the spacing: the planes alone count then. Discs, which hold a
# little along the surface too, suit noisy clouds; here they would drag the poses towards the nearest points.
PLANES_ALONE_SPACINGS = 0.4
# Fraction of the information in one cell that is believed at most.
MAX_LEVERAGE = 0.9
# How near edges and rims hold what no face holds, in spacings.
LOCKED_SPACINGS = 0.5
# Rounds that fit the scale of the distances.
SCALE_ROUNDS = 20


@dataclasses.dataclass(frozen=True)
class WeighedMatches:
    """Matches of one pair at one pose, weighed."""

    target: int  # Node whose planes count
    source: int  # Node whose points count
    matches: BodyMatches  # Between the centred frames
    weights: FloatArray  # (n,): Probabilities to be an inlier
    mixture: InlierMixture  # Of the distances along the normals
    spacing: float  # Of the source
    firm: BoolArray  # (n,): On one face on either side, as far as the points around tell

    @property
    def count(self) -> float:
        """Inliers."""
        return float(self.weights.sum())

    @property
    def sigma(self) -> float:
        """Standard deviation of the distances along the normals."""
        return self.mixture.scale

    @cached_property
    def form(self) -> QuadraticForm:
        """The cost in units of the variance of the distances, between the centred frames."""
        m, w = self.matches, self.weights
        p, q, n = m.points, m.feet, m.normals
        origins = (w @ p / w.sum(), w @ q / w.sum())
        if m.variances is not None and self.sigma > PLANES_ALONE_SPACINGS * self.spacing:
            spreads = BEND_VARIANCE + m.variances, BEND_VARIANCE + m.turned_variances
            matrix = plane_to_plane_form(p, q, (n, m.turned), spreads, 2.0 * BEND_VARIANCE * w, origins)
        else:
            matrix = plane_form(p, q, n, w, origins)
        return QuadraticForm(matrix / self.sigma**2, *origins)

    @property
    def on_faces(self) -> WeighedMatches:
        """Those alone whose planes are those of faces: fits across an edge are tilted by what lies around them."""
        return dataclasses.replace(self, weights=np.where(self.firm, self.weights, 0.0))

    @property
    def locked(self) -> FloatArray:
        """Information about the target's origin if all that is matched were placed to half a spacing, (6, 6).

        So near do edges and rims hold whatever slides along the faces: their points come to lie between those of the
        other scan, wherever these happen to be.
        """
        spread = _arms(self.matches.moved)
        weights = self.weights / self.weights.sum()
        return np.asarray(np.einsum("k,kij,klj->il", weights, spread, spread) / (LOCKED_SPACINGS * self.spacing) ** 2)

    @property
    def apparent(self) -> FloatArray:
        """Part of the information that is due to errors of the normals alone, about the target's origin, (6, 6).

        A plane tilted by an error e has the row ``(x, n + e)``: its square holds ``E[e e^T]`` too, as if the plane held
        motions along itself. It does not: errors in variables.
        """
        variances = self.matches.variances
        if variances is None or self.sigma > PLANES_ALONE_SPACINGS * self.spacing:
            return np.zeros((6, 6))
        n = self.matches.normals
        # A normal's variance is the sum over two tangential axes.
        share = 0.5 * self.weights * np.minimum(variances, 1.0) / self.sigma**2
        rows = _arms(self.matches.moved)
        along = rows - np.einsum("kij,kj->ki", rows, n)[:, :, None] * n[:, None]
        return np.asarray(np.einsum("k,kij,klj->il", share, along, along))

    def scores(self, T_world_target: FloatArray, cell: float, relative: FloatArray) -> tuple[IntArray, FloatArray]:
        """Numbers of the cells of the world that hold points, and the slope of the cost by world increments of each.

        Relative is the inverse of what all pairs together say of the source against the target, (6, 6).
        Shapes: cells (k,), slopes (k, 6).
        """
        kept = np.flatnonzero(self.weights > 0.0)
        x, n = self.matches.moved[kept], self.matches.normals[kept]
        along = self.matches.aside[kept] * self.weights[kept] / self.sigma**2
        x, n = pose.apply(T_world_target, x), n @ T_world_target[:3, :3].T
        rows = np.hstack([np.cross(x, n), n])
        cells, group = np.unique(cell_numbers(x, cell), return_inverse=True)
        slopes: FloatArray = np.column_stack([np.bincount(group, column * along, len(cells)) for column in rows.T])
        return cells, _leverage_corrected(
            slopes, rows * (np.sqrt(self.weights[kept]) / self.sigma)[:, None], group, relative
        )


def _arms(points: FloatArray) -> FloatArray:
    """What a twist about the origin does to points, transposed, (n, 6, 3)."""
    x, y, z = points.T
    o = np.zeros(len(points))
    turns = np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)
    return np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=1)


def _leverage_corrected(slopes: FloatArray, rows: FloatArray, group: IntArray, relative: FloatArray) -> FloatArray:
    """Slopes of cells, (k, 6), as large as they were before the poses were fitted to them too.

    A cell that alone holds a motion has residuals of zero there, whatever its error: along each motion the squares are
    divided by the share that the others leave open, which makes the sandwich unbiased (HC2 of MacKinnon and White 1985,
    of clusters Bell and McCaffrey 2002). Rows are in units of the noise, relative as in `WeighedMatches.scores`.
    """
    scale = np.sqrt(np.diag(relative))
    values, vectors = np.linalg.eigh(relative / scale / scale[:, None])
    root = np.sqrt(np.maximum(values, 1e-12))
    whitened = (rows * scale) @ vectors * root
    shares = np.zeros((len(slopes), 6, 6))
    for i in range(6):
        for j in range(i, 6):
            shares[:, i, j] = shares[:, j, i] = np.bincount(group, whitened[:, i] * whitened[:, j], len(slopes))
    own, turned = np.linalg.eigh(shares)
    along = np.einsum("kij,ki->kj", turned, (slopes * scale) @ vectors * root)
    along /= np.sqrt(1.0 - np.minimum(own, MAX_LEVERAGE))
    return np.asarray(np.einsum("kij,kj->ki", turned, along) / root @ vectors.T / scale)


def planes_of(
    nodes: tuple[int, int],
    source: Body,
    target: Body,
    matches: BodyMatches,
    reach: float,
    before: WeighedMatches | None = None,
    soft: float = 0.0,
) -> WeighedMatches | None:
    """Matches robustly weighed; None where there are too few.

    The scale of the distances is that of this pair: scans differ in noise. It begins at that of the planes before, and
    is so many spacings at least.
    """
    assert source.scan is not None
    if len(matches.aside) < MIN_PLANES:
        return None
    aside, floor = np.abs(matches.aside), max(source.noise_floor, target.noise_floor, soft * source.scan.spacing)
    begun = InlierMixture.widest(reach, floor)
    if before is not None:
        begun = dataclasses.replace(before.mixture, limit=reach)
    mixture = begun.fit(aside, floor=floor, rounds=SCALE_ROUNDS)
    weights = mixture.weight(aside) * _sureness(matches, mixture.scale)
    # Below a millionth the weight is rounding.
    weights[weights < 1e-6] = 0.0
    # The planes of a part are those of its faces, whatever lies around a point.
    firm = np.ones(len(aside), dtype=bool)
    if target.scan is not None:
        firm = (matches.roughness <= source.rough) & (matches.target_roughness <= target.rough)
    found = WeighedMatches(*nodes, matches, weights, mixture, source.scan.spacing, firm)
    return found if found.count >= MIN_PLANES else None


def _sureness(matches: BodyMatches, sigma: float) -> FloatArray:
    """Share of the variance of each distance that is not due to the tilt of its plane, (n,).

    A plane that is tilted by a little errs by so much of the way from its point to the foot: fits across an edge do.
    """
    if matches.variances is None:
        return np.ones(len(matches.aside))
    along = np.maximum(matches.distances**2 - matches.aside**2, 0.0)
    return np.asarray(sigma**2 / (sigma**2 + matches.variances * along))
