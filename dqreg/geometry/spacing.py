"""How the points of a cloud lie: how far apart neighbours stand, and how all lie about their mean."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, bounds, median
from dqreg.errors import InputError
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import PlaneFits, sample_rows

# Enough for a median that is good to one per cent.
SPACING_SAMPLE = 5_000


def measure_spacing(tree: NeighbourTree, points: FloatArray, sample: int = SPACING_SAMPLE) -> float:
    """Median distance from a point to its nearest neighbour that is not a duplicate of it, of so many points.

    >>> line = np.arange(12.0).reshape(-1, 1) * [2.0, 0.0, 0.0]
    >>> measure_spacing(NeighbourTree(line), line)
    2.0
    """
    _, distances = tree.nearest_to(sample_rows(len(points), sample), 2)
    return _usual_gap(distances[:, -1], points)


def spacing_of(fits: PlaneFits, points: FloatArray) -> float:
    """The same from distances that are known already, of distinct points."""
    gaps = np.zeros(0) if fits.gaps is None else fits.gaps
    return _usual_gap(gaps[sample_rows(len(gaps), SPACING_SAMPLE)], points)


def _usual_gap(gaps: FloatArray, points: FloatArray) -> float:
    if gaps.max(initial=0.0) > 0.0:
        return median(gaps[gaps > 0.0])
    # Every sampled point has a twin; only a cloud that is one single place has no spacing at all.
    extent = float(np.linalg.norm(np.subtract(*bounds(points))))
    if extent == 0.0:
        raise InputError(f"all {len(points)} points coincide; a pose needs points at three places at least")
    return extent / len(points)


@dataclasses.dataclass(frozen=True)
class Spread:
    """Mean and second moment of the source points: all that the size of a motion depends on."""

    mean: FloatArray  # (3,): Mean of the points
    covariance: FloatArray  # (3, 3): Their covariance

    @staticmethod
    def of(points: FloatArray) -> Spread:
        """Moments of points, (n, 3)."""
        from dqreg.kernels.clouds.point_spread import spread_of
        from dqreg.kernels.threads import as_plain

        mean, covariance = np.zeros(3), np.zeros((3, 3))
        spread_of(as_plain(points), mean, covariance)
        return Spread(mean, covariance)

    @property
    def size(self) -> float:
        """Root mean square distance of the points from their mean."""
        return float(np.sqrt(np.trace(self.covariance)))

    def motion(self, T_a: FloatArray, T_b: FloatArray) -> float:
        """Root mean square distance that the points travel between two poses, without moving any of them."""
        from dqreg.kernels.clouds.point_spread import rms_motion
        from dqreg.kernels.threads import as_plain

        return rms_motion(as_plain(T_a), as_plain(T_b), self.mean, self.covariance)
