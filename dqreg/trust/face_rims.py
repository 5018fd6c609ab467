"""Rims of the faces of a cloud in a plane: where they are, and whether another cloud has them too."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, median
from dqreg.geometry.angles import gaps_around
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows

# Points of a cloud at the pose, and a tree of them in their own frame, which is asked about its own points alone: those
# have the same neighbours at any pose.
Points = tuple[FloatArray, NeighbourTree]
Rows = NDArray[np.int32]

# Neighbours of a point in space that tell whether its face lies in the plane, and the share of them that lie there.
SPACE_NEIGHBOURS, IN_PLANE_SHARE = 8, 0.6
# Neighbours in the plane that leave so wide an angle without any about a point on a rim.
PLANE_NEIGHBOURS, OPEN_RAD = 20, np.deg2rad(140.0)
OPEN_COS = float(np.cos(OPEN_RAD))
# A point that has them within so many times the usual distance only is on no face.
SPARSE_RATIO = 2.0
# What the distance to the last of these is of the edge of the square that each has for itself.
NEIGHBOUR_REACH_SPACINGS = float(np.sqrt(np.pi / PLANE_NEIGHBOURS))
# Points of a plane of which its spacing is measured: good to some per cent.
SPACING_SAMPLE = 100
# Points of a plane without which it has no rims.
MIN_PLANE_POINTS = 30
# Rims within so many spacings of another plane end there in any case.
PLANE_MEETING_SPACINGS = 1.5
# Rims are the same where their points are within so many spacings of each other,
SAME_RIM_SPACINGS = 1.2
# of so many nearest ones, and look the same way.
NEAREST_RIMS, SAME_RIM_COS = 4, 0.7
# Places whose neighbours one thread looks at in one go: to hand over fewer takes longer.
CHUNK_PLACES = 8_192
# Points on rims without which nothing is said.
MIN_RIM_POINTS = 30


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space."""

    middle: FloatArray  # (3,)
    normal: FloatArray  # (3,)

    def holds(self, points: FloatArray, within: float) -> BoolArray:
        """Which points, (n, 3), lie in it."""
        return np.asarray(np.abs((points - self.middle) @ self.normal) < within)

    @cached_property
    def across(self) -> FloatArray:
        """Two directions in it, (2, 3)."""
        axes: FloatArray = np.linalg.svd(self.normal[None])[2][1:]
        return axes


@dataclasses.dataclass(frozen=True, eq=False)
class Rims:
    """Points of a cloud in a plane at which its faces end."""

    rows: IntArray  # (n,): Of the cloud
    points: FloatArray  # (n, 3)
    outward: FloatArray  # (n, 3): Directions in the plane to the side without points
    counted: BoolArray  # (n,): Whether it is not the rim along which another common plane begins
    spacing: float  # Edge of the square that a point has for itself


@dataclasses.dataclass(frozen=True, eq=False)
class Faces:
    """Points of a cloud that lie in a plane, and how much of what is beside each does too."""

    rows: IntArray  # (n,): Of the cloud
    lines: IntArray  # (n,): Where their neighbours in space stand
    beside: Rows  # (l, k): Rows of these, itself the first
    shares: FloatArray  # (n,): Of so many of these, what lies in the plane

    @staticmethod
    def of(tree: NeighbourTree, heights: FloatArray, within: float) -> Faces:
        """Those of a cloud within a distance of a plane, over which all of its points have these heights, (N,)."""
        from dqreg.kernels.evidence.planar_boundary import near_fractions
        from dqreg.kernels.threads import over_chunks

        near = np.abs(heights) < within
        rows = np.flatnonzero(near)
        lines, beside = tree.beside(rows, SPACE_NEIGHBOURS)
        shares = np.zeros(len(rows))
        over_chunks(near_fractions, len(rows), lines, beside, SPACE_NEIGHBOURS, near, shares, chunk=CHUNK_PLACES)
        return Faces(rows, lines, beside, shares)

    def flat(self, share: float = IN_PLANE_SHARE) -> IntArray:
        """Points whose faces lie in the plane, (m,): those of which more than a share of the neighbours does."""
        return self.rows[self.shares > share]


@dataclasses.dataclass(frozen=True, eq=False)
class Held:
    """The faces of a cloud in a plane that thick to either side: where their points are in it, and how dense."""

    points: FloatArray  # (N, 3): Of the cloud
    plane: Plane
    within: float
    rows: IntArray  # (n,): Points of the faces, of the cloud
    neighbours: tuple[IntArray, Rows]  # Their lines, (n,), of a table of neighbours in space
    flat: FloatArray  # (n, 2): Where they are in the plane
    tree: NeighbourTree  # Of these
    usual: float  # Distance to the last of the neighbours in the plane that are asked of a rim

    @staticmethod
    def of(points: FloatArray, faces: Faces, plane: Plane, within: float) -> Held | None:
        """Those of a cloud, (N, 3); None where few of its points are in the plane."""
        rows = faces.flat()
        if len(rows) < MIN_PLANE_POINTS:
            return None
        flat = (np.take(points, rows, axis=0) - plane.middle) @ plane.across.T
        tree = NeighbourTree(lifted(flat), in_order=True)
        usual = median(tree.nearest_to(sample_rows(len(flat), SPACING_SAMPLE), PLANE_NEIGHBOURS + 1)[1][:, -1])
        neighbours = faces.lines[faces.shares > IN_PLANE_SHARE], faces.beside
        return Held(points, plane, within, rows, neighbours, flat, tree, usual)

    @property
    def spacing(self) -> float:
        """Edge of the square that a point has for itself."""
        return self.usual * NEIGHBOUR_REACH_SPACINGS

    def rims(self, planes: Sequence[Plane], asked: IntArray | None = None) -> Rims:
        """Rims among the points asked, (m,) of these, or all; one of some planes is this one."""
        asked = np.arange(len(self.rows)) if asked is None else asked
        lines, beside = self.neighbours
        neighbours = np.take(lines, asked), beside
        places = self.points, self.rows, self.flat, asked
        rows = asked[~surrounded(*places, neighbours, self.within, beside=SPACE_NEIGHBOURS)]
        found, apart = self.tree.nearest_to(rows, PLANE_NEIGHBOURS + 1)
        open_rad, towards = open_sides(np.take(self.flat, rows, axis=0), self.flat, found)
        is_rim = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE_RATIO * self.usual)
        rims = self.rows[rows[is_rim]]
        points = np.take(self.points, rims, axis=0)
        counted = np.ones(len(points), dtype=bool)
        for other in planes:
            if other is not self.plane:
                counted &= ~other.holds(points, PLANE_MEETING_SPACINGS * self.spacing)
        outward = np.column_stack([np.cos(towards), np.sin(towards)])[is_rim] @ self.plane.across
        return Rims(rims, points, outward, counted, self.spacing)

    def near(self, points: FloatArray, reach: float) -> IntArray:
        """Which of these, (m,), have any of some points along a curve, (k, 3), within reach."""
        near: IntArray = np.flatnonzero(stand_near(self.points, self.rows, points, np.arange(len(points)), reach))
        return near


def surrounded(
    points: FloatArray,
    held: IntArray,
    flat: FloatArray,
    asked: IntArray,
    neighbours: tuple[IntArray, Rows],
    within: float,
    *,
    beside: int = 0,
) -> BoolArray:
    """Which of some points within a distance of a plane have others all around them: these are on no rim, (m,).

    By so many neighbours in space, or by what these tell for certain of the nearest ones in the plane, which need not
    be searched for then: no point is left out that those would leave on no rim alone.

    Shapes: points (N, 3), held (n,), rows of those in the plane, flat (n, 2), asked (m,), rows of flat; neighbours are
    the lines, (m,), of a table, (l, k).
    """
    from dqreg.kernels.evidence.planar_boundary import interior_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    places, found = np.full(len(points), -1), np.zeros(len(asked), dtype=bool)
    places[held] = np.arange(len(held))
    given = asked, flat, held, places, as_plain(points), *neighbours
    limits = PLANE_NEIGHBOURS + 1, 2.0 * within, OPEN_COS
    over_chunks(interior_rows, len(asked), *given, beside, *limits, found, chunk=CHUNK_PLACES)
    return found


def shared_rims(rims: Sequence[Rims | None], others: Sequence[Rims | None]) -> float:
    """Share of a cloud's rims that are rims of another one's faces in the same planes too; NaN for few."""
    both = [(one, other) for one, other in zip(rims, others, strict=True) if one is not None and other is not None]
    count, shared = np.sum([shared_count(*each) for each in both], axis=0) if both else (0, 0)
    return float(shared / count) if count >= MIN_RIM_POINTS else np.nan


def shared_count(one: Rims, other: Rims) -> tuple[int, int]:
    """How many of a cloud's rims in a plane count, and how many of these are rims of another one's faces too."""
    count = int(np.count_nonzero(one.counted))
    if len(other.points) < NEAREST_RIMS or not count:
        return count, 0
    return count, int(np.count_nonzero(_alike(one, other, one.counted)[1].any(axis=1)))


def _alike(one: Rims, other: Rims, asked: BoolArray) -> tuple[IntArray, BoolArray]:
    """The other cloud's rims next to those asked, (m, k), and whether they are the same ones."""
    rows, apart = NeighbourTree(other.points, in_order=True).nearest(one.points[asked], NEAREST_RIMS)
    look_alike = np.einsum("ijk,ik->ij", other.outward[rows], one.outward[asked]) > SAME_RIM_COS
    return rows, look_alike & (apart < SAME_RIM_SPACINGS * max(one.spacing, other.spacing))


def shared_along(
    rims: Sequence[Rims | None], others: Sequence[Rims | None], axis: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """The share of the rims that both clouds have, of the cloud with more of it, where one is slid along an axis.

    Returns slides (k,), in steps in which rims are the same, zero in the middle, and shares (k,), NaN for few rims.
    """
    both = [(one, other) for one, other in zip(rims, others, strict=True) if one is not None and other is not None]
    if not both:
        return np.zeros(1), np.full(1, np.nan)
    step = SAME_RIM_SPACINGS * max(max(one.spacing, other.spacing) for one, other in both)
    count = int(np.ceil(reach / step))
    slides, shared, total = np.arange(-count, count + 1.0), np.zeros((2, 2 * count + 1)), np.zeros(2)
    for one, other in both:
        gaps = other.points - one.points[:, None]
        along = gaps @ axis
        aside = np.sqrt(np.maximum(np.einsum("ijk,ijk->ij", gaps, gaps) - along**2, 0.0))
        alike = (aside < step) & (one.outward @ other.outward.T > SAME_RIM_COS) & (np.abs(along) < reach)
        pair = np.nonzero(alike)
        for side, cloud in enumerate((one, other)):
            counted = cloud.counted[pair[side]]
            rows, at = pair[side][counted], along[pair][counted] / step
            # Slides on either side of the distance bring the two within a step of each other; each point counts once.
            reached = np.concatenate([np.floor(at), np.ceil(at)]).astype(np.intp) + count
            each = np.unique(np.concatenate([rows, rows]) * len(slides) + reached)
            shared[side] += np.bincount(each % len(slides), minlength=len(slides))
            total[side] += np.count_nonzero(cloud.counted)
    shares = np.where(total < MIN_RIM_POINTS, np.nan, shared.T / np.maximum(total, 1.0))
    return slides * step, np.fmax(shares[:, 0], shares[:, 1])


def lifted(flat: FloatArray) -> FloatArray:
    """Points of a plane, (n, 2), in space, as trees take them."""
    found = np.zeros((len(flat), 3))
    found[:, :2] = flat
    return found


def open_sides(at: FloatArray, flat: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Widest angle without a neighbour about points of a plane, (m, 2), and its direction, in radians.

    Shapes: flat (n, 2), of which rows (m, k) are the nearest to each point, itself the first.
    """
    (x, y), others = np.ascontiguousarray(flat.T), rows[:, 1:]
    angles, gaps = gaps_around(np.arctan2(np.take(y, others) - at[:, 1:], np.take(x, others) - at[:, :1]))
    each, widest = np.arange(len(at)), gaps.argmax(axis=1)
    return gaps[each, widest], angles[each, widest] + 0.5 * gaps[each, widest]


def stand_near(points: FloatArray, rows: IntArray, cloud: FloatArray, others: IntArray, reach: float) -> BoolArray:
    """Which rows of some points, (m,), have one of the other rows of a cloud within reach; all along curves."""
    from dqreg.kernels.threads import as_plain
    from dqreg.kernels.trees.near_rows import near_rows
    from dqreg.kernels.trees.point_tree import LEAF_POINTS

    found = np.zeros(len(rows), dtype=bool)
    near_rows(as_plain(points), rows, as_plain(cloud), others, LEAF_POINTS, float(reach), found)
    return found
