"""Rims beside which the faces of a cloud turn to one side of a plane, and whether those of another one do too."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.trust.face_rims import IN_PLANE_SHARE, NEAREST_RIMS, SAME_RIM_COS, SPACE_NEIGHBOURS, Points
from dqreg.trust.limits import OPPOSED_EDGE_SHARE

# Neighbours of a rim in space, within so many spacings, that tell to which side of the plane the faces beside it turn.
RIM_NEIGHBOURS, RIM_REACH_SPACINGS = 20, 3.0
# As many at least, nearly all on one side.
MIN_TURNING_NEIGHBOURS, ONE_SIDE_SHARE = 2, 0.9
# Rims that both clouds have in a plane without which nothing is said of them.
MIN_TURNING_RIMS = 10
# Standard errors by which a share of some rims is below its limit, or above it, for certain.
CERTAIN_SIGMAS = 4.0


class Turning(NamedTuple):
    """Rims beside which the faces turn to one side."""

    points: FloatArray  # (n, 3)
    outward: FloatArray  # (n, 3): Directions in the plane to the side without points
    side: FloatArray  # (n,): Side of the plane to which the faces turn: 1 along its normal, or -1

    @staticmethod
    def of(
        rows: IntArray, outward: FloatArray, cloud: Points, heights: FloatArray, within: float, spacing: float
    ) -> Turning:
        """Of some rims of a cloud, (m,) rows, whose points have these heights over the plane, (n,)."""
        side = _sides(rows, cloud, heights, within, spacing)
        told = side != 0.0
        return Turning(np.take(cloud[0], rows[told], axis=0), outward[told], side[told])


class SharedTurning(NamedTuple):
    """Rims of both clouds beside which the faces turn to a side in either."""

    opposed: float  # Share of them where these are opposite ones; NaN for few
    told: int  # How many they are

    @property
    def are_hardly_opposed(self) -> bool:
        """Whether the share of all rims is below its limit for certain, where these are some of them."""
        error = math.sqrt(max(self.opposed * (1.0 - self.opposed), 1.0 / max(self.told, 1)) / max(self.told, 1))
        return self.opposed + CERTAIN_SIGMAS * error < OPPOSED_EDGE_SHARE


def shared_turning(one: Turning, other: Turning, reach: float) -> SharedTurning:
    """Those of one cloud that have some of the other, which look the same way, within reach."""
    if len(other.points) < NEAREST_RIMS or len(one.points) < MIN_TURNING_RIMS:
        return SharedTurning(np.nan, 0)
    rows, apart = NeighbourTree(other.points, in_order=True).nearest(one.points, NEAREST_RIMS)
    alike = (np.einsum("ijk,ik->ij", other.outward[rows], one.outward) > SAME_RIM_COS) & (apart < reach)
    sides = np.where(alike, one.side[:, None] * other.side[rows], 0.0)
    told = int(np.count_nonzero((sides != 0.0).any(axis=1)))
    opposed = int(np.count_nonzero((sides < 0.0).any(axis=1) & ~(sides > 0.0).any(axis=1)))
    return SharedTurning(opposed / told if told >= MIN_TURNING_RIMS else np.nan, told)


def _sides(rows: IntArray, cloud: Points, heights: FloatArray, within: float, spacing: float) -> FloatArray:
    """Side of the plane, 1 or -1, on which the points beside some rows of the cloud lie, (m,).

    0 for few, for both, and where the face of a row is not in the plane.
    """
    tree = cloud[1]
    found, apart = tree.nearest_to(rows, min(RIM_NEIGHBOURS, tree.size))
    around = heights[found]
    is_face = (np.abs(around[:, :SPACE_NEIGHBOURS]) < within).mean(axis=1) > IN_PLANE_SHARE
    around = np.where(apart < RIM_REACH_SPACINGS * spacing, around, 0.0)
    above, below = (np.count_nonzero(side * around > within, axis=1) for side in (1.0, -1.0))
    told = is_face & (np.maximum(above, below) >= np.maximum(MIN_TURNING_NEIGHBOURS, ONE_SIDE_SHARE * (above + below)))
    return np.where(told, np.sign(above - below), 0.0)
