"""Rims beside which the faces of two clouds turn to opposite sides of a plane that both have in common.

Both sides of a wall laid on each other are one plane; the faces beside them tell that it is not one face: a face ends
at a convex edge or at a concave one, never at both.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median
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
# Points of a plane of which its spacing is measured: good to some per cent; and those next to each along the curve that
# tell what it is at most.
SAMPLE, WINDOW = 100, 48


@dataclasses.dataclass(frozen=True, eq=False)
class InPlane:
    """Points of a cloud that lie in a plane, in the order of the cloud, along a space-filling curve."""

    cloud: Points
    plane: Plane
    within: float  # Distance from the plane within which a point lies in it
    heights: FloatArray  # (n,): Of all points of the cloud over the plane
    rows: IntArray  # (m,): Of the cloud
    flat: FloatArray  # (m, 2): Where those are in the plane
    most_spacing: float  # What the edge of the square that a point has for itself is at most
    off: IntArray  # (l,): Rows of the cloud off the plane that a point in it may stand beside
    beside: IntArray  # (k,): Those that may stand beside one of them: no other does

    @staticmethod
    def of(cloud: Points, heights: FloatArray, plane: Plane, within: float) -> InPlane | None:
        """Of a cloud whose heights over the plane are known; None where few of its points are in the plane."""
        aside = np.abs(heights)
        rows = np.flatnonzero(aside < within)
        if len(rows) < FEWEST:
            return None
        flat = (np.take(cloud[0], rows, axis=0) - plane.middle) @ plane.across.T
        most = _most_spacing(flat)
        off = np.flatnonzero((aside > within) & (aside < within + REACH * most))
        beside = np.flatnonzero(aside[rows] > within - REACH * most)
        beside = beside[_near(cloud[0], rows[beside], cloud[0], off, REACH * most)]
        return InPlane(cloud, plane, within, heights, rows, flat, most, off, beside)

    def places(self, k: IntArray) -> FloatArray:
        """Where some of the points are, (k, 3)."""
        return np.take(self.cloud[0], self.rows[k], axis=0)

    def beside_any(self, reach: float) -> IntArray:
        """Which of those that may do stand within a shorter reach of a point off the plane, (m,)."""
        off = self.off[np.abs(self.heights[self.off]) < self.within + reach]
        k = self.beside[np.abs(self.heights[self.rows[self.beside]]) > self.within - reach]
        near: IntArray = k[_near(self.cloud[0], self.rows[k], self.cloud[0], off, reach)]
        return near

    def beside_one(self, side: float) -> IntArray:
        """Which rows of the cloud that may do may stand beside a point on a side of the plane, 1 or -1, (m,)."""
        off, rows = self.off[side * self.heights[self.off] > 0.0], self.rows[self.beside]
        near: IntArray = rows[_near(self.cloud[0], rows, self.cloud[0], off, REACH * self.most_spacing)]
        return near


@dataclasses.dataclass(frozen=True, eq=False)
class Beside:
    """Points of a cloud in a plane that stand beside one of its points off it: few, no other can be on such a rim."""

    held: InPlane
    tree: NeighbourTree  # Of the points in the plane
    usual: float  # Distance to the last of the neighbours in the plane that are asked of a rim
    rows: IntArray  # (k,): Those beside a point off it, of the points in the plane

    @staticmethod
    def of(held: InPlane) -> Beside:
        """Of points in a plane."""
        tree = NeighbourTree(lifted(held.flat), in_order=True)
        usual = median(tree.nearest_to(sample_rows(len(held.flat), SAMPLE), AROUND + 1)[1][:, -1])
        return Beside(held, tree, usual, held.beside_any(REACH * usual * OF_SPACING))

    @property
    def spacing(self) -> float:
        """Edge of the square that a point in the plane has for itself."""
        return self.usual * OF_SPACING

    def rims(self, asked: BoolArray) -> Turning:
        """Which of those asked, (k,), are rims beside which the faces turn to one side."""
        rows = self.rows[asked]
        side = self._sides(self.held.rows[rows])
        rows, side = rows[side != 0.0], side[side != 0.0]
        found, apart = self.tree.nearest_to(rows, AROUND + 1)
        open_rad, towards = open_sides(self.held.flat[rows], self.held.flat, found)
        is_rim = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE * self.usual)
        outward = np.column_stack([np.cos(towards), np.sin(towards)])[is_rim] @ self.held.plane.across
        return Turning(self.held.places(rows[is_rim]), outward, side[is_rim])

    def _sides(self, rows: IntArray) -> FloatArray:
        """Side of the plane, 1 or -1, on which the points beside some rows of the cloud lie, (m,).

        0 for few, for both, and where the face of a row is not in the plane.
        """
        tree, within = self.held.cloud[1], self.held.within
        found, apart = tree.nearest_to(rows, min(BESIDE_RIM, tree.size))
        around = self.held.heights[found]
        is_face = (np.abs(around[:, :BESIDE]) < within).mean(axis=1) > MOSTLY
        around = np.where(apart < REACH * self.spacing, around, 0.0)
        above, below = (np.count_nonzero(side * around > within, axis=1) for side in (1.0, -1.0))
        told = is_face & (np.maximum(above, below) >= np.maximum(TURNING, NEARLY_ALL * (above + below)))
        return np.where(told, np.sign(above - below), 0.0)


class Turning(NamedTuple):
    """Rims beside which the faces turn to one side."""

    points: FloatArray  # (n, 3)
    outward: FloatArray  # (n, 3): Directions in the plane to the side without points
    side: FloatArray  # (n,): Side of the plane to which the faces turn: 1 along its normal, or -1


def opposed_share(
    clouds: tuple[Points, Points], heights: tuple[FloatArray, FloatArray], plane: Plane, within: float
) -> float:
    """Share of the rims that both clouds have in a plane beside which faces turn to opposite sides; NaN for few.

    0 where there can be none, however many rims there are. Heights are those of all points over the plane, (n,) each.
    """
    one, other = (InPlane.of(*side, plane, within) for side in zip(clouds, heights, strict=True))
    if one is None or other is None:
        return np.nan
    if not _may_be_opposed(one, other):
        return 0.0 if min(len(one.beside), len(other.beside)) >= FEWEST_TURNING else np.nan
    first, second = Beside.of(one), Beside.of(other)
    reach = SAME * max(first.spacing, second.spacing)
    # What has none of the other cloud's beside it is no rim of both, whatever it is.
    here, there = (one.cloud[0], one.rows[first.rows]), (other.cloud[0], other.rows[second.rows])
    asked = _near(*here, *there, reach), _near(*there, *here, reach)
    if np.count_nonzero(asked[0]) < FEWEST_TURNING:
        return np.nan
    return _opposed_of(first.rims(asked[0]), second.rims(asked[1]), reach)


def _may_be_opposed(one: InPlane, other: InPlane) -> bool:
    """Whether anywhere a point of one cloud stands beside others on one side, and one of the other on the other side.

    A rim is such a point, whichever these are. In scans of one scene there is hardly any.
    """
    reach = SAME * max(one.most_spacing, other.most_spacing)
    return any(
        _near(one.cloud[0], one.beside_one(side), other.cloud[0], other.beside_one(-side), reach).any()
        for side in (1.0, -1.0)
    )


def _opposed_of(one: Turning, other: Turning, reach: float) -> float:
    """Share of the rims of both clouds, within reach of each other, beside which they turn to opposite sides."""
    if len(other.points) < NEAREST or len(one.points) < FEWEST_TURNING:
        return np.nan
    rows, apart = NeighbourTree(other.points, in_order=True).nearest(one.points, NEAREST)
    alike = (np.einsum("ijk,ik->ij", other.outward[rows], one.outward) > SAME_COS) & (apart < reach)
    sides = np.where(alike, one.side[:, None] * other.side[rows], 0.0)
    told = np.count_nonzero((sides != 0.0).any(axis=1))
    opposed = np.count_nonzero((sides < 0.0).any(axis=1) & ~(sides > 0.0).any(axis=1))
    return opposed / told if told >= FEWEST_TURNING else np.nan


def _most_spacing(flat: FloatArray) -> float:
    """What the edge of the square of a point of a plane, (n, 2), is at most.

    Its neighbours are no farther off than those among the points next to it along the curve.
    """
    rows, count = sample_rows(len(flat), SAMPLE), min(WINDOW, len(flat))
    firsts, last = np.clip(rows - count // 2, 0, len(flat) - count), min(AROUND, count - 1)
    # Number by number: pairs are too short to go over one after the other.
    x, y = (axis[firsts[:, None] + np.arange(count)] - axis[rows, None] for axis in flat.T.copy())
    return OF_SPACING * math.sqrt(median(np.partition(x * x + y * y, last, axis=1)[:, last]))


def _near(points: FloatArray, rows: IntArray, cloud: FloatArray, others: IntArray, reach: float) -> BoolArray:
    """Which rows of some points, (m,), have one of the other rows of a cloud within reach; all along curves."""
    from dqreg.kernels.near_rows import near_rows
    from dqreg.kernels.point_tree import LEAF
    from dqreg.kernels.threads import as_plain

    found = np.zeros(len(rows), dtype=bool)
    near_rows(as_plain(points), rows, as_plain(cloud), others, LEAF, float(reach), found)
    return found
