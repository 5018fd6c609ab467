"""What is left between two clouds at a pose, where both show one smooth surface: faces that lie apart, a strain.

The distances of points between clouds are those between neighbours. A point's distance from the other cloud's point
next to it, along the mean of both planes' normals, is free of that, to the third order of the curvature (Rusinkiewicz
2019): what is left is noise, and what differs between the clouds.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NEIGHBOURS, PlaneFits, fit_planes_among, fit_planes_around, sample_rows
from dqreg.rigid import pose
from dqreg.solvers.quadratic import plane_rows
from dqreg.trust.deformation import deformation_of
from dqreg.trust.patch_tests import waviness_of
from dqreg.trust.strain import SIGNIFICANT_CLUTTER, Strain, robust_fit, strain_of, weights_of

# Points that are compared; comparisons without which nothing is said.
ASKED, FEWEST = 2_000, 60
# Planes of the two are of one face where their normals are within this angle, neighbours leave this share of their
# extent at most, or so many times the usual noise, and the points are less than this share of it beside each other.
SAME_COS, FLAT, NOISY, FLATTEST, BESIDE = np.cos(np.deg2rad(15.0)), 0.15, 2.0, 0.4, 0.7
# Comparisons of a patch; patches lie apart whose median is this many times the noise, and this share of the size: what
# is many times the noise from a smaller share on. Fragments of a room that drifted come to 2 and 0.0015, streets to 6
# and 0.0003.
PATCH, APART, LEAST, CLEARLY, LEAST_CLEARLY = 16, 1.0, 2e-3, 4.0, 7e-4
# Fewer patches than this are a thing that moved, or chance: fragments of a kitchen came to 2 of 26.
FEWEST_APART = 4
# The same at the pose itself, beyond what its covariance leaves.
APART_THERE = 5.0
# What the residuals of so many nearest neighbours have in common is no noise where it is so many times that from point
# to point: ripples of 0.3 to 0.6 % came to 2.4 and more, right poses of measured pairs to 1.65. Neighbours on a curve
# through the points stand farther apart, and what a ripple changes between them looks like noise: 1.6 and 1.44.
BESIDE_EACH, IN_COMMON = 2, 2.0
# A strain matters that displaces the surface by this share of the size, root mean square.
SHOWN = 3e-4


@dataclasses.dataclass(frozen=True)
class IndexedPoints:
    """Points of one side, each place once, in the order of a space-filling curve, and a tree of them."""

    points: FloatArray
    tree: NeighbourTree
    planes: PlaneFits | None = None  # At all of the points, where they were fitted before
    is_remembered: bool = False  # Whether the tree was asked for neighbours of its own points before

    @staticmethod
    def of(points: FloatArray) -> IndexedPoints:
        """Of points in any order, for few queries."""
        points = points[distinct_in_order(points)]
        return IndexedPoints(points, NeighbourTree(points, in_order=True))

    @cached_property
    def some(self) -> tuple[IntArray, PlaneFits]:
        """Rows of the points that are compared, and planes there."""
        rows = sample_rows(len(self.points), ASKED)
        return rows, self.planes_at(rows)

    def planes_at(self, rows: IntArray) -> PlaneFits:
        """Planes through the neighbours of some of the points."""
        if self.planes is not None:
            return self.planes.taken(rows)
        if self.is_remembered:
            return fit_planes_around(self.tree, self.points, rows, NEIGHBOURS)
        return fit_planes_among(self.points, self.tree.nearest(self.points[rows], NEIGHBOURS)[0])


@dataclasses.dataclass(frozen=True)
class Overlap:
    """Places at which two clouds show one smooth surface, in the order of a space-filling curve."""

    points: FloatArray  # (n, 3): Target frame
    normals: FloatArray  # (n, 3)
    residuals: FloatArray  # (n,): Distances along the normals
    noise: FloatArray  # (n,): Standard deviations of those, from how far neighbours leave their planes

    @staticmethod
    def of(moves: IndexedPoints, stands: IndexedPoints, T_target_source: FloatArray) -> Overlap | None:
        """Of two clouds at a pose, (4, 4); None where they have hardly any such place."""
        if min(len(moves.points), len(stands.points)) < FEWEST:
            return None
        rows, one = moves.some
        placed = pose.apply(T_target_source, moves.points[rows])
        found = stands.tree.nearest(placed, 1)[0][:, 0]
        fixed, other = stands.points[found], stands.planes_at(found)
        normals, theirs = np.nan_to_num(one.normals) @ T_target_source[:3, :3].T, np.nan_to_num(other.normals)
        cosines = np.einsum("ij,ij->i", normals, theirs)
        normals = theirs + np.where(cosines < 0.0, -1.0, 1.0)[:, None] * normals
        normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
        gaps = placed - fixed
        residuals = np.einsum("ij,ij->i", gaps, normals)
        beside = np.linalg.norm(gaps - residuals[:, None] * normals, axis=1)
        kept = _is_flat(one) & _is_flat(other) & (np.abs(cosines) > SAME_COS)
        kept &= beside < BESIDE * np.sqrt(np.fmax(one.lever, other.lever))
        if np.count_nonzero(kept) < FEWEST:
            return None
        noise = np.hypot(one.residuals, other.residuals)[kept]
        middles = 0.5 * (placed + fixed)[kept]
        return Overlap(middles, normals[kept], residuals[kept], noise)

    @cached_property
    def _moved(self) -> FloatArray:
        """Residuals after the motion that leaves the least of them, (n,)."""
        middle = self.points.mean(axis=0)
        lever = float(np.sqrt(((self.points - middle) ** 2).sum(axis=1).mean()))
        if not lever > 0.0:
            return self.residuals
        rows = plane_rows(self.points, self.normals, middle, lever)
        fitted, _ = robust_fit(rows, self.residuals, lever, weights_of(self.residuals))
        return np.asarray(self.residuals - fitted @ rows)

    def apart(self, size: float, covariance: FloatArray) -> float:
        """Share of the patches that lie apart, of clouds of a size, whatever motion the pose's covariance leaves.

        Those that lie apart at the pose by more than it leaves count, and those that no motion brings together.
        """
        count = len(self.points) // PATCH
        whole = slice(count * PATCH)
        noise = np.sqrt((self.noise[whole].reshape(count, PATCH) ** 2).mean(axis=1))
        here, best = (np.abs(np.median(r[whole].reshape(count, PATCH), axis=1)) for r in (self.residuals, self._moved))
        arms = plane_rows(self.points[whole], self.normals[whole], np.zeros(3), 1.0)
        arms = arms.reshape(6, count, PATCH).mean(axis=2)
        known = np.hypot(noise, np.linalg.norm(_root(covariance).T @ arms, axis=0))
        off = best > np.maximum(APART * noise, LEAST * size)
        off |= best > np.maximum(CLEARLY * noise, LEAST_CLEARLY * size)
        off |= here > np.maximum(APART_THERE * known, LEAST * size)
        return float(np.mean(off)) if np.count_nonzero(off) >= FEWEST_APART else 0.0

    def waviness(self) -> float:
        """What neighbouring residuals have in common after the best motion, one sigma; 0 where it is noise."""
        kept = weights_of(self._moved) > 0.0
        points = self.points[kept]
        if len(points) <= BESIDE_EACH:
            return 0.0
        beside = NeighbourTree(points, in_order=True).nearest(points, BESIDE_EACH + 1)[0][:, 1:]
        shared, noise = waviness_of(self._moved[kept], self.normals[kept], beside)
        return shared if shared > IN_COMMON * noise else 0.0

    def strain(self, size: float) -> Strain:
        """Strain of one cloud against the other that matters to a size; zeros else."""
        # Places on both are no clutter, a whole face that is off may be what a strain explains; but they are chosen.
        found = strain_of(self.points, self.normals, self.residuals)
        found = dataclasses.replace(found, significant=SIGNIFICANT_CLUTTER)
        return found if found.shown >= SHOWN * size else Strain()

    def deformation(self, size: float) -> float:
        """Displacement of the surface of one cloud by a deformation, root mean square; 0 for none."""
        return deformation_of(self.points, self.normals, self.residuals, size)


def _is_flat(fits: PlaneFits) -> BoolArray:
    """Which neighbourhoods, (n,), are flat for their extent, or but for noise."""
    extents = np.sqrt(fits.lever)
    known = fits.residuals[np.isfinite(fits.residuals)]
    usual = float(np.quantile(known, 0.3)) if len(known) else 0.0
    limits = np.minimum(np.maximum(FLAT * extents, NOISY * usual), FLATTEST * extents)
    return np.asarray(np.nan_to_num(fits.residuals, nan=np.inf) < limits)


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix whose square is a covariance, (6, 6); what is NaN counts as zero."""
    values, vectors = np.linalg.eigh(np.nan_to_num(covariance, nan=0.0))
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
