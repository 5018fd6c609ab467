"""Rims beside which the faces of two clouds turn to opposite sides of a plane that both have in common.

Both sides of a wall laid on each other are one plane; the faces beside them tell that it is not one face: a face ends
at a convex edge or at a concave one, never at both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray, median
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.threads import unlocked_property
from dqreg.trust.face_rims import (
    MIN_PLANE_POINTS,
    NEIGHBOUR_REACH_SPACINGS,
    OPEN_RAD,
    PLANE_NEIGHBOURS,
    SAME_RIM_SPACINGS,
    SPARSE_RATIO,
    Plane,
    Points,
    lifted,
    open_sides,
    stand_near,
    surrounded,
)
from dqreg.trust.turning_rims import MIN_TURNING_RIMS, RIM_NEIGHBOURS, RIM_REACH_SPACINGS, Turning, shared_turning

# Points that are asked first whether they are such rims.
FIRST_POINTS = 150
# Points of a plane of which its spacing is measured: good to some per cent; and those next to each along the curve that
# tell what it is at most.
SPACING_SAMPLE, CURVE_WINDOW = 100, 48
# What heights are rounded by at most, in distances within which a point lies in the plane.
HEIGHT_ROUNDING = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class InPlane:
    """Points of a cloud that lie in a plane, in the order of the cloud, along a space-filling curve."""

    cloud: Points
    plane: Plane
    within: float  # Distance from the plane within which a point lies in it
    heights: FloatArray  # (n,): Of all points of the cloud over the plane
    rows: IntArray  # (m,): Of the cloud
    most_spacing: float  # What the edge of the square that a point has for itself is at most

    @staticmethod
    def of(cloud: Points, heights: FloatArray, plane: Plane, within: float) -> InPlane | None:
        """Of a cloud whose heights over the plane are known; None where few of its points are in the plane."""
        rows = np.flatnonzero(np.abs(heights) < within)
        if len(rows) < MIN_PLANE_POINTS:
            return None
        return InPlane(cloud, plane, within, heights, rows, _most_spacing(cloud[0], heights, rows))

    @unlocked_property
    def over(self) -> FloatArray:
        """Heights of the points over the plane, (m,)."""
        return np.asarray(self.heights[self.rows])

    @unlocked_property
    def flat(self) -> FloatArray:
        """Where the points are in the plane, (m, 2)."""
        return np.asarray((np.take(self.cloud[0], self.rows, axis=0) - self.plane.middle) @ self.plane.across.T)

    @unlocked_property
    def off(self) -> IntArray:
        """Rows of the cloud off the plane that a point in it may stand beside, (l,)."""
        aside = np.abs(self.heights)
        return np.flatnonzero((aside > self.within) & (aside < self.within + self.reach))

    @unlocked_property
    def beside(self) -> IntArray:
        """Those of the points that may stand beside one of them, (k,): no other does."""
        k = np.flatnonzero(np.abs(self.over) > self.within - self.reach)
        near: IntArray = k[stand_near(self.cloud[0], self.rows[k], self.cloud[0], self.off, self.reach)]
        return near

    @property
    def reach(self) -> float:
        """How far the points beside a rim are away from it at most."""
        return RIM_REACH_SPACINGS * self.most_spacing

    def places(self, k: IntArray) -> FloatArray:
        """Where some of the points are, (k, 3)."""
        return np.take(self.cloud[0], self.rows[k], axis=0)

    def beside_any(self, reach: float) -> IntArray:
        """Which of those that may do stand within a shorter reach of a point off the plane, (m,)."""
        off = self.off[np.abs(self.heights[self.off]) < self.within + reach]
        k = np.flatnonzero(np.abs(self.over) > self.within - reach)
        near: IntArray = k[stand_near(self.cloud[0], self.rows[k], self.cloud[0], off, reach)]
        return near

    def lower(self, side: float, limit: float) -> IntArray:
        """Rows so high on a side of the plane, 1 or -1, that one beyond may be beside them, and no higher, (k,)."""
        heights = side * self.over
        return self.rows[(heights > self.within - self.reach) & (heights < limit)]

    def beside_one(self, rows: IntArray, side: float) -> IntArray:
        """Which of some rows of the cloud may stand beside a point off the plane on a side, 1 or -1, (m,)."""
        off = self.off[side * self.heights[self.off] > 0.0]
        near: IntArray = rows[stand_near(self.cloud[0], rows, self.cloud[0], off, self.reach)]
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
        usual = median(tree.nearest_to(sample_rows(len(held.flat), SPACING_SAMPLE), PLANE_NEIGHBOURS + 1)[1][:, -1])
        return Beside(held, tree, usual, held.beside_any(RIM_REACH_SPACINGS * usual * NEIGHBOUR_REACH_SPACINGS))

    @property
    def spacing(self) -> float:
        """Edge of the square that a point in the plane has for itself."""
        return self.usual * NEIGHBOUR_REACH_SPACINGS

    def rims(self, asked: IntArray) -> Turning:
        """Which of those asked, (m,) of these, are rims beside which the faces turn to one side."""
        held, rows = self.held, self.rows[asked]
        cloud, tree = held.cloud
        neighbours = tree.beside(held.rows[rows], RIM_NEIGHBOURS)
        rows = rows[~surrounded(cloud, held.rows, held.flat, rows, neighbours, held.within)]
        found, apart = self.tree.nearest_to(rows, PLANE_NEIGHBOURS + 1)
        open_rad, towards = open_sides(held.flat[rows], held.flat, found)
        is_rim = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE_RATIO * self.usual)
        rows, towards = rows[is_rim], towards[is_rim]
        outward = np.column_stack([np.cos(towards), np.sin(towards)]) @ held.plane.across
        return Turning.of(held.rows[rows], outward, held.cloud, held.heights, held.within, self.spacing)


@dataclasses.dataclass(frozen=True, eq=False)
class Opposed:
    """Points of two clouds that lie in a plane, and to which sides the faces beside their rims turn."""

    one: InPlane
    other: InPlane

    @staticmethod
    def of(
        clouds: tuple[Points, Points], heights: tuple[FloatArray, FloatArray], plane: Plane, within: float
    ) -> Opposed | None:
        """None where few points are in the plane. Heights are those of all points over the plane, (n,) each."""
        one, other = (InPlane.of(*side, plane, within) for side in zip(clouds, heights, strict=True))
        if one is None or other is None:
            return None
        found = Opposed(one, other)
        _ = found.share
        return found

    @unlocked_property
    def share(self) -> float | None:
        """Share of the rims that both have beside which faces turn to opposite sides; NaN for few, None for nowhere."""
        if not _may_be_opposed(self.one, self.other):
            return None
        first, second = Beside.of(self.one), Beside.of(self.other)
        reach = SAME_RIM_SPACINGS * max(first.spacing, second.spacing)
        # What has none of the other cloud's beside it is no rim of both, whatever it is.
        here, there = ((x.held.cloud[0], x.held.rows[x.rows]) for x in (first, second))
        asked = np.flatnonzero(stand_near(*here, *there, reach))
        if len(asked) < MIN_TURNING_RIMS:
            return np.nan
        # Some of them first: hardly ever is there anything opposed.
        for some in (asked[sample_rows(len(asked), FIRST_POINTS)], asked):
            beside = stand_near(*there, here[0], here[1][some], reach)
            found = shared_turning(first.rims(some), second.rims(np.flatnonzero(beside)), reach)
            if len(some) == len(asked) or found.are_hardly_opposed:
                break
        return found.opposed

    @property
    def may_have_rims(self) -> bool:
        """Whether enough points of either cloud may be on rims, which are opposed nowhere."""
        return min(len(self.one.beside), len(self.other.beside)) >= MIN_TURNING_RIMS


def opposed_share(planes: Sequence[Opposed | None], others: Sequence[float] = ()) -> float:
    """Share of the rims beside which faces turn to opposite sides, of the plane with most of it; NaN for few rims.

    Of other planes that share is known. 0 where there can be none, however many rims there are: of those planes no more
    is asked where others tell.
    """
    known = [plane for plane in planes if plane is not None]
    shares = [*others, *(plane.share for plane in known if plane.share is not None)]
    found = float(np.fmax.reduce(shares, initial=np.nan))
    if math.isnan(found) and any(plane.share is None and plane.may_have_rims for plane in known):
        return 0.0
    return found


def _may_be_opposed(one: InPlane, other: InPlane) -> bool:
    """Whether anywhere a point of one cloud stands beside others on one side, and one of the other on the other side.

    A rim is such a point, whichever these are. In scans of one scene there is hardly any: the two have to be near each
    other, and each so near to its side of the plane, which leaves few to be asked.
    """
    reach = SAME_RIM_SPACINGS * max(one.most_spacing, other.most_spacing)
    for side in (1.0, -1.0):
        # Rounded up.
        here = one.lower(side, (other.reach - one.within + reach) + HEIGHT_ROUNDING * one.within)
        there = other.lower(-side, (one.reach - one.within + reach) + HEIGHT_ROUNDING * one.within)
        # Few of the one are left whenever the other is asked.
        here = _near(one, here, other, there, reach)
        here = one.beside_one(here, side) if len(here) else here
        there = _near(other, there, one, here, reach)
        if len(there) and len(other.beside_one(there, -side)):
            return True
    return False


def _near(one: InPlane, rows: IntArray, other: InPlane, others: IntArray, reach: float) -> IntArray:
    """Which of some rows of one cloud have some of the other's within reach, (m,)."""
    if not len(rows) or not len(others):
        return rows[:0]
    near: IntArray = rows[stand_near(one.cloud[0], rows, other.cloud[0], others, reach)]
    return near


def _most_spacing(points: FloatArray, heights: FloatArray, rows: IntArray) -> float:
    """What the edge of the square of a point of a plane is at most, of those of a cloud, (m,), and all heights over it.

    Its neighbours are no farther off than those among the points next to it along the curve.
    """
    from dqreg.kernels.evidence.planar_boundary import in_plane_sq_distances
    from dqreg.kernels.threads import as_plain

    some, count = sample_rows(len(rows), SPACING_SAMPLE), min(CURVE_WINDOW, len(rows))
    squares = np.zeros(len(some))
    in_plane_sq_distances(
        as_plain(points), as_plain(heights), rows, some, count, min(PLANE_NEIGHBOURS, count - 1), squares
    )
    return NEIGHBOUR_REACH_SPACINGS * math.sqrt(max(median(squares), 0.0))
