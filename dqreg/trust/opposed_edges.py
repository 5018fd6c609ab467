"""Rims beside which the faces of two clouds turn to opposite sides of a plane that both have in common.

Both sides of a wall laid on each other are one plane; the faces beside them tell that it is not one face: a face ends
at a convex edge or at a concave one, never at both.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median, product
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.trust.face_rims import (
    AROUND,
    BESIDE,
    FEWEST,
    MOSTLY,
    NEAREST,
    OF_SPACING,
    OPEN_RAD,
    SAME,
    SAME_COS,
    SPARSE,
    Plane,
    Points,
    lifted,
    open_sides,
)

# Neighbours of a rim in space, within so many spacings, that tell to which side of the plane the faces beside it turn:
# as many at least, nearly all on one side. Rims that both clouds have in a plane without which nothing is said of them.
BESIDE_RIM, REACH, TURNING, NEARLY_ALL, FEWEST_TURNING = 20, 3.0, 2, 0.9, 10
# Points of a plane of which its spacing is measured: good to some per cent.
SAMPLE = 100


@dataclasses.dataclass(frozen=True, eq=False)
class Beside:
    """Points of a cloud in a plane that stand beside its points on either side: few, and no other can be on such a rim.

    The points in the plane are in the order of the cloud, along a space-filling curve.
    """

    cloud: Points
    plane: Plane
    within: float  # Distance from the plane within which a point lies in it
    heights: FloatArray  # (n,): Of all points of the cloud over the plane
    inside: IntArray  # (m,): Rows of the cloud in the plane
    flat: FloatArray  # (m, 2): Where those are in it
    tree: NeighbourTree  # Of these
    usual: float  # Distance to the last of the neighbours in the plane that are asked of a rim
    sides: tuple[IntArray, IntArray]  # Rows of the points in the plane that stand beside one above it, and one below

    @staticmethod
    def of(cloud: Points, plane: Plane, within: float) -> Beside | None:
        """Of a cloud; None where few of its points are in the plane."""
        points = cloud[0]
        # A product of matrices takes a third of the time of one with a vector.
        heights = product(plane.normal[None], points.T)[0] - plane.middle @ plane.normal
        inside = np.flatnonzero(np.abs(heights) < within)
        if len(inside) < FEWEST:
            return None
        flat = (np.take(points, inside, axis=0) - plane.middle) @ plane.across.T
        tree = NeighbourTree(lifted(flat), in_order=True)
        usual = median(tree.nearest_to(sample_rows(len(flat), SAMPLE), AROUND + 1)[1][:, -1])
        reach = REACH * usual * OF_SPACING
        sides = []
        for side in (1.0, -1.0):
            over = side * heights
            others = np.flatnonzero((over > within) & (over < within + reach))
            rows = np.flatnonzero(over[inside] > within - reach)
            sides.append(rows[_near(points[inside[rows]], points[others], reach)])
        return Beside(cloud, plane, within, heights, inside, flat, tree, usual, (sides[0], sides[1]))

    @property
    def spacing(self) -> float:
        """Edge of the square that a point in the plane has for itself."""
        return self.usual * OF_SPACING

    @cached_property
    def rows(self) -> IntArray:
        """Those beside one on either side, (k,)."""
        beside = np.zeros(len(self.inside), dtype=bool)
        for rows in self.sides:
            beside[rows] = True
        return np.flatnonzero(beside)

    def places(self, rows: IntArray) -> FloatArray:
        """Where points in the plane are, (m, 3)."""
        return np.take(self.cloud[0], self.inside[rows], axis=0)

    def rims(self, asked: BoolArray) -> Turning:
        """Which of those asked, (k,), are rims beside which the faces turn to one side."""
        rows = self.rows[asked]
        side = self._sides(self.inside[rows])
        rows, side = rows[side != 0.0], side[side != 0.0]
        found, apart = self.tree.nearest_to(rows, AROUND + 1)
        open_rad, towards = open_sides(self.flat[rows], self.flat, found)
        is_rim = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE * self.usual)
        outward = np.column_stack([np.cos(towards), np.sin(towards)])[is_rim] @ self.plane.across
        return Turning(self.cloud[0][self.inside[rows[is_rim]]], outward, side[is_rim])

    def _sides(self, rows: IntArray) -> FloatArray:
        """Side of the plane, 1 or -1, on which the points beside some rows of the cloud lie, (m,).

        0 for few, for both, and where the face of a row is not in the plane.
        """
        tree = self.cloud[1]
        found, apart = tree.nearest_to(rows, min(BESIDE_RIM, tree.size))
        around = self.heights[found]
        is_face = (np.abs(around[:, :BESIDE]) < self.within).mean(axis=1) > MOSTLY
        around = np.where(apart < REACH * self.spacing, around, 0.0)
        above, below = (np.count_nonzero(side * around > self.within, axis=1) for side in (1.0, -1.0))
        told = is_face & (np.maximum(above, below) >= np.maximum(TURNING, NEARLY_ALL * (above + below)))
        return np.where(told, np.sign(above - below), 0.0)


class Turning(NamedTuple):
    """Rims beside which the faces turn to one side."""

    points: FloatArray  # (n, 3)
    outward: FloatArray  # (n, 3): Directions in the plane to the side without points
    side: FloatArray  # (n,): Side of the plane to which the faces turn: 1 along its normal, or -1


def opposed_share(clouds: tuple[Points, Points], plane: Plane, within: float) -> float:
    """Share of the rims that both clouds have in a plane beside which faces turn to opposite sides; NaN for few.

    0 where there can be none, however many rims there are.
    """
    first, second = (Beside.of(cloud, plane, within) for cloud in clouds)
    if first is None or second is None:
        return np.nan
    reach = SAME * max(first.spacing, second.spacing)
    # What has none of the other cloud's beside it is no rim of both, whatever it is.
    shared = _near(first.places(first.rows), second.places(second.rows), reach)
    if np.count_nonzero(shared) < FEWEST_TURNING:
        return np.nan
    # Of points beside the same side alone no rims are opposed, whichever these are: nearly all, in scans of one scene.
    if not any(
        _near(first.places(one), second.places(other), reach).any()
        for one, other in zip(first.sides, second.sides[::-1], strict=True)
    ):
        return 0.0
    one = first.rims(shared)
    other = second.rims(_near(second.places(second.rows), first.places(first.rows), reach))
    if len(other.points) < NEAREST or len(one.points) < FEWEST_TURNING:
        return np.nan
    rows, apart = NeighbourTree(other.points, in_order=True).nearest(one.points, NEAREST)
    alike = (np.einsum("ijk,ik->ij", other.outward[rows], one.outward) > SAME_COS) & (apart < reach)
    sides = np.where(alike, one.side[:, None] * other.side[rows], 0.0)
    told = np.count_nonzero((sides != 0.0).any(axis=1))
    opposed = np.count_nonzero((sides < 0.0).any(axis=1) & ~(sides > 0.0).any(axis=1))
    return opposed / told if told >= FEWEST_TURNING else np.nan


def _near(points: FloatArray, others: FloatArray, reach: float) -> BoolArray:
    """Which points, (n, 3), have one of the others, in the order of a space-filling curve, within reach."""
    if not len(others):
        return np.zeros(len(points), dtype=bool)
    return np.asarray(NeighbourTree(others, in_order=True).capped_distances(points, reach) < reach)
