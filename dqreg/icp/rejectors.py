"""Rejectors and weights: small callables from `Correspondences` to (n,) factors; factors multiply, zero rejects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.surface import Closest, Surface
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp.correspondences import Correspondences
from dqreg.solvers.robust import Kernel

Weight = Callable[[Correspondences], FloatArray]

# Kernel scales from a boundary edge within which noise alone decides whether the closest point is on it.
STRIP_SCALES = 3.0


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
    if not weights:
        return np.ones(len(pairs.distances))
    total = weights[0](pairs)
    for weight in weights[1:]:
        total = total * weight(pairs)
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
        return _kept(self.rejects(pairs.closest))

    def rejects(self, closest: Closest) -> BoolArray:
        """Which target points are at the boundary, (n,)."""
        return self.borders.near(closest.points, self.margin)


@dataclasses.dataclass(frozen=True)
class RejectCloudBoundary:
    """Rejects correspondences to boundary points of a cloud."""

    surface: CloudSurface

    def __call__(self, pairs: Correspondences) -> FloatArray:
        """0 at the boundary, else 1."""
        return _kept(self.rejects(pairs.closest))

    def rejects(self, closest: Closest) -> BoolArray:
        """Which target points are at the boundary, (n,)."""
        return self.surface.on_rim(closest)


def _kept(out: BoolArray) -> FloatArray:
    """1 for what is not rejected, else 0."""
    kept: FloatArray = np.logical_not(out).astype(np.float64)
    return kept


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
