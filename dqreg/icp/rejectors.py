"""Rejectors and weights: small callables from `Correspondences` to (n,) factors; factors multiply, zero rejects.

Between two clouds weights are lowered once more, by heights, distances and noise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, median, quantile
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.surface import Closest, Surface
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.solvers.robust import GAUSSIAN_MEDIAN, Kernel

Weight = Callable[[Correspondences], FloatArray]

# Kernel scales from a boundary edge within which noise alone decides whether the closest point is on it.
STRIP_SCALES = 3.0
# Heights, in their usual size, at which a correspondence between cells counts half, and on the last level distances, in
# their median. Of 60 simulated streets under a LiDAR the errors fell to a half, the worst to a fifth; measured pairs
# lost up to a twentieth. At 6 and 1, and at 20 and 2, the streets lost less or these gained.
HALF_WEIGHT_HEIGHTS, HALF_WEIGHT_DISTANCES = 12.0, 1.5
# Variance of both normals, rad^2, at which a correspondence counts half; more where all but this share of them has
# more. Where the noise of a depth camera, which grows with the square of the distance, is beyond the spacing of its
# points, any of them is near any other: they hold the pose where it is. Of simulated tables before a far wall errors
# fell to a quarter and, with half as much noise again, to an eighth, their squares from 3 and 10 of the covariance to
# 0.3.
HALF_WEIGHT_VARIANCE, SURE_SHARE = 0.05, 0.1
# Asked where the squares of the spacings of a scan, by its neighbourhoods, spread so wide from its first to its last
# tenth: depth cameras came to 5 and more, scans of parts to 3.4 at most. There edges and small details are no planes
# either, and hold what the faces do not.
MIN_SPREAD_RATIO = 5.0
# Power of that variance: with half of it, errors at twice the noise were three times as large.
NOISE_POWER = 8


@dataclasses.dataclass(frozen=True)
class WithinDistance:
    """Rejects correspondences farther apart than the limit, a length in the target's unit."""

    limit: float

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """1 within the limit, else 0."""
        return np.where(pairs.distances <= self.limit, 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class NormalAngle:
    """Rejects correspondences whose normals differ by more than the limit; without a normal on either side they pass.

    Where the sign of either normal is unknown, the angle between the lines counts, 0 to 90 degrees.
    """

    limit_rad: float

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """1 within the limit or without normals, else 0."""
        rows = np.flatnonzero(nonzero_rows(pairs.scan._rejecting_normals))
        factors = np.ones(len(pairs.distances))
        cosines = pairs.normal_cosines[rows] if pairs.same_sign else np.abs(pairs.normal_cosines[rows])
        known = nonzero_rows(pairs.closest.normals[rows])
        factors[rows] = np.where((cosines >= np.cos(self.limit_rad)) | ~known, 1.0, 0.0)
        return factors


@dataclasses.dataclass(frozen=True)
class Robust:
    """Weights by a robust kernel of the distance."""

    kernel: Kernel

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """The kernel's weights."""
        return self.kernel.weight(pairs.distances)


@dataclasses.dataclass(frozen=True)
class Trimmed:
    """Keeps the given fraction of the correspondences, the closest ones (Chetverikov et al. 2002)."""

    fraction: float

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """1 for the closest, else 0."""
        keep = int(np.ceil(self.fraction * len(pairs.distances)))
        weights = np.zeros(len(pairs.distances))
        weights[np.argsort(pairs.distances, kind="stable")[:keep]] = 1.0
        return weights


def product(weights: Sequence[Weight], pairs: Correspondences) -> FloatArray:
    """Product of all factors, (n,)."""
    total = np.ones(len(pairs.distances))
    for weight in weights:
        total *= weight(pairs)
    return total


@dataclasses.dataclass(frozen=True)
class RejectMeshBoundary:
    """Rejects correspondences whose target point lies within a margin of the boundary of an open mesh.

    A scan continues where an open mesh ends, and its points beyond the edge lie all on one side: they would bias the
    pose. The strip depends on target points alone, never on distances from the target, so that rejecting it adds no
    bias.
    """

    borders: MeshBoundary
    margin: float

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """0 at the boundary, else 1."""
        return np.where(self.rejects(pairs.closest), 0.0, 1.0)

    def rejects(self, closest: Closest) -> BoolArray:
        """Which target points are at the boundary, (n,)."""
        return self.borders.near(closest.points, self.margin)


@dataclasses.dataclass(frozen=True)
class RejectCloudBoundary:
    """Rejects correspondences to boundary points of a cloud."""

    surface: CloudSurface

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """0 at the boundary, else 1."""
        return np.where(self.rejects(pairs.closest), 0.0, 1.0)

    def rejects(self, closest: Closest) -> BoolArray:
        """Which target points are at the boundary, (n,)."""
        return self.surface.on_rim(closest)


def boundary_rejectors(surface: Surface, width: float) -> tuple[RejectMeshBoundary | RejectCloudBoundary, ...]:
    """The rejector for an open target."""
    if isinstance(surface, CloudSurface):
        return (RejectCloudBoundary(surface),)
    borders = surface.borders if isinstance(surface, MeshSurface) else None
    return () if borders is None else (RejectMeshBoundary(borders, STRIP_SCALES * width),)


def at_boundary(closest: Closest, surface: Surface, width: float) -> BoolArray:
    """Which target points are at the boundary of an open target, (n,)."""
    out = np.zeros(len(closest.distances), dtype=bool)
    for rejector in boundary_rejectors(surface, width):
        out |= rejector.rejects(closest)
    return out


def beyond_boundary(pairs: Correspondences, surface: Surface, width: float, reach: float) -> BoolArray:
    """Correspondences within reach that the boundary rejectors reject, (n,)."""
    return at_boundary(pairs.closest, surface, width) & (pairs.distances <= reach)


def weights_by_height(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    """Weights of correspondences between cells, less where they are far off the target's planes for most of them.

    Cells are as far apart as they are wide, which is all that the kernel of their distances knows: beside a kerb, on
    which they stand askew, they are off by a fraction of that, and by many times what others are. Cauchy's weight.
    """
    kept = np.flatnonzero(weights)
    if not isinstance(pairs.surface, CellSurface) or not len(kept):
        return weights
    heights = np.abs(pairs.point_to_plane)
    # Noise that both clouds were rid of is no reason to believe less in faces that are not in place yet.
    usual = math.hypot(median(heights[kept]), math.sqrt(2.0) * pairs.surface.smoothed_by)
    scale = HALF_WEIGHT_HEIGHTS * GAUSSIAN_MEDIAN * usual
    return weights / (1.0 + (heights / scale) ** 2) if scale > 0.0 else weights


def weights_by_distance(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    """Weights of correspondences between cells, less where these are farther apart than most.

    A surface bends away from its plane by the square of the way along it, so that the variance of the height grows with
    its fourth power. Where the rings of a LiDAR are metres apart on the ground, cells have their partners at the next
    ring: few as they are, their long levers would decide on roll and pitch. A plane that was found flat far around does
    not bend, and leans by the error of its normal: the variance grows with the square, and what it holds alone it does.
    """
    kept = np.flatnonzero(weights)
    if not isinstance(pairs.surface, CellSurface) or not len(kept):
        return weights
    scale = HALF_WEIGHT_DISTANCES * median(pairs.distances[kept])
    if not scale > 0.0:
        return weights
    squares = (pairs.distances / scale) ** 2
    if not pairs.surface.wide.any():
        return weights / (1.0 + squares**2)
    return weights / (1.0 + np.where(pairs.surface.wide[pairs.closest.elements], squares, squares**2))


def weights_by_noise(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    """Weights of correspondences between points, next to none where their neighbourhoods are noise, and no planes.

    Cells are rid of their noise.
    """
    kept, levers = np.flatnonzero(weights), pairs.scan.levers
    if isinstance(pairs.surface, CellSurface) or pairs.closest.variances is None or not len(kept):
        return weights
    known = levers[levers > 0.0]
    if not quantile(known, 0.9) >= MIN_SPREAD_RATIO * quantile(known, 0.1):
        return weights
    variances = pairs.closest.variances + pairs.scan._variances
    half = max(HALF_WEIGHT_VARIANCE, quantile(variances[kept], SURE_SHARE))
    return weights / (1.0 + (variances / half) ** NOISE_POWER)
