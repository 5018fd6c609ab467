"""Rims and holes of the faces of a cloud in a plane: where they are, and whether another cloud has them too."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, median
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows

# Points of a cloud at the pose, and a tree of them in their own frame, which is asked about its own points alone: those
# have the same neighbours at any pose.
Points = tuple[FloatArray, NeighbourTree]
Rows = NDArray[np.int32]

# Neighbours of a point in space that tell whether its face lies in the plane, and the share of them that lie there.
BESIDE, MOSTLY = 8, 0.6
# Neighbours in the plane that leave so wide an angle without any about a point on a rim; a point that has them within
# so many times the usual distance only is on no face.
AROUND, SPARSE, OPEN_RAD = 20, 2.0, np.deg2rad(140.0)
OPEN_COS = float(np.cos(OPEN_RAD))
# What the distance to the last of these is of the edge of the square that each has for itself.
OF_SPACING = float(np.sqrt(np.pi / AROUND))
# Points of a plane of which its spacing is measured: good to two per cent.
SAMPLE = 300
# Points of a plane without which it has no rims; rims within so many spacings of another plane end there in any case.
FEWEST, MEETING = 30, 1.5
# Rims are the same where their points are within so many spacings of each other and look the same way.
SAME, NEAREST, SAME_COS = 1.2, 4, 0.7
# Points on rims without which nothing is said.
FEWEST_RIMS = 30
# Width of a cell of the plane, in spacings of its points; a plane of more cells has a point far away, and is not asked.
CELL, MOST_CELLS = 2.0, 1 << 22
# Cells of a hole, and how much of them the other's face holds: of right pairs of generated views gaps of up to 4 cells
# between the points were filled.
FEWEST_CELLS, FILLED = 5, 0.8
# So many cells around a hole so much of them holds points: beams of a LiDAR leave gaps on the ground amid gaps (0.81 at
# most), holes of generated views are in whole faces (0.97 at least).
SURROUNDING, WHOLE = 3, 0.9
# What stands beside the hole, so many cells high at most, may hide the face there from one side.
STANDING = 20.0


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

    points: FloatArray  # (n, 3)
    outward: FloatArray  # (n, 3): Directions in the plane to the side without points
    counted: BoolArray  # (n,): Whether it is not the rim along which another common plane begins
    spacing: float  # Edge of the square that a point has for itself
    faces: FloatArray  # (2, m): Where the points of the faces are in the plane


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
        from dqreg.kernels.surrounded import shares_beside
        from dqreg.kernels.threads import over_chunks

        near = np.abs(heights) < within
        rows = np.flatnonzero(near)
        lines, beside = tree.beside(rows, BESIDE)
        shares = np.zeros(len(rows))
        over_chunks(shares_beside, len(rows), lines, beside, BESIDE, near, shares)
        return Faces(rows, lines, beside, shares)

    def flat(self, share: float = MOSTLY) -> IntArray:
        """Points whose faces lie in the plane, (m,): those of which more than a share of the neighbours does."""
        return self.rows[self.shares > share]


def rims_in(points: FloatArray, faces: Faces, plane: Plane, planes: Sequence[Plane], within: float) -> Rims | None:
    """Rims of a cloud's faces in one of some planes, that thick to either side; None where few of its points are."""
    held = faces.flat()
    if len(held) < FEWEST:
        return None
    across = plane.across
    flat = (np.take(points, held, axis=0) - plane.middle) @ across.T
    tree = NeighbourTree(lifted(flat), in_order=True)
    usual = median(tree.nearest_to(sample_rows(len(flat), SAMPLE), AROUND + 1)[1][:, -1])
    neighbours = faces.lines[faces.shares > MOSTLY], faces.beside
    rows = np.flatnonzero(~surrounded(points, held, flat, np.arange(len(flat)), neighbours, within, beside=BESIDE))
    found, apart = tree.nearest_to(rows, AROUND + 1)
    open_rad, towards = open_sides(flat[rows], flat, found)
    is_rim, spacing = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE * usual), usual * OF_SPACING
    points = points[held[rows[is_rim]]]
    counted = np.ones(len(points), dtype=bool)
    for other in planes:
        if other is not plane:
            counted &= ~other.holds(points, MEETING * spacing)
    outward = np.column_stack([np.cos(towards), np.sin(towards)])[is_rim] @ across
    return Rims(points, outward, counted, spacing, np.ascontiguousarray(flat.T))


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
    from dqreg.kernels.surrounded import surrounded_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    places, found = np.full(len(points), -1), np.zeros(len(asked), dtype=bool)
    places[held] = np.arange(len(held))
    given = asked, flat, held, places, as_plain(points), *neighbours
    over_chunks(surrounded_rows, len(asked), *given, beside, AROUND + 1, 2.0 * within, OPEN_COS, found)
    return found


def shared_rims(rims: Sequence[Rims | None], others: Sequence[Rims | None]) -> float:
    """Share of a cloud's rims that are rims of another one's faces in the same planes too; NaN for few."""
    count = shared = 0
    for one, other in zip(rims, others, strict=True):
        if one is None or other is None:
            continue
        count += int(np.count_nonzero(one.counted))
        if len(other.points) < NEAREST or not one.counted.any():
            continue
        shared += int(np.count_nonzero(_alike(one, other, one.counted)[1].any(axis=1)))
    return shared / count if count >= FEWEST_RIMS else np.nan


def _alike(one: Rims, other: Rims, asked: BoolArray) -> tuple[IntArray, BoolArray]:
    """The other cloud's rims next to those asked, (m, k), and whether they are the same ones."""
    rows, apart = NeighbourTree(other.points, in_order=True).nearest(one.points[asked], NEAREST)
    look_alike = np.einsum("ijk,ik->ij", other.outward[rows], one.outward[asked]) > SAME_COS
    return rows, look_alike & (apart < SAME * max(one.spacing, other.spacing))


def shared_along(
    rims: Sequence[Rims | None], others: Sequence[Rims | None], axis: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """The share of the rims that both clouds have, of the cloud with more of it, where one is slid along an axis.

    Returns slides (k,), in steps in which rims are the same, zero in the middle, and shares (k,), NaN for few rims.
    """
    both = [(one, other) for one, other in zip(rims, others, strict=True) if one is not None and other is not None]
    step = SAME * max((max(one.spacing, other.spacing) for one, other in both), default=np.inf)
    count = int(np.ceil(reach / step))
    slides, shared, total = np.arange(-count, count + 1.0), np.zeros((2, 2 * count + 1)), np.zeros(2)
    for one, other in both:
        gaps = other.points - one.points[:, None]
        along = gaps @ axis
        aside = np.sqrt(np.maximum(np.einsum("ijk,ijk->ij", gaps, gaps) - along**2, 0.0))
        alike = (aside < step) & (one.outward @ other.outward.T > SAME_COS) & (np.abs(along) < reach)
        pair = np.nonzero(alike)
        for side, cloud in enumerate((one, other)):
            counted = cloud.counted[pair[side]]
            rows, at = pair[side][counted], along[pair][counted] / step
            # Slides on either side of the distance bring the two within a step of each other; each point counts once.
            reached = np.concatenate([np.floor(at), np.ceil(at)]).astype(np.intp) + count
            each = np.unique(np.concatenate([rows, rows]) * len(slides) + reached)
            shared[side] += np.bincount(each % len(slides), minlength=len(slides))
            total[side] += np.count_nonzero(cloud.counted)
    shares = np.where(total < FEWEST_RIMS, np.nan, shared.T / np.maximum(total, 1.0))
    return slides * step, np.fmax(shares[:, 0], shares[:, 1])


def closed_hole(one: Rims, theirs: Rims, other: FloatArray, plane: Plane, within: float) -> float:
    """Diameter of the largest hole in a cloud's faces in a plane where another one's faces go on; 0 for none.

    Rims are of the faces of both clouds, points those of the other one, (n, 3). A hole is a place without points that
    the first one's enclose. Where anything of the other cloud stands beside it, that may hide the face from one side,
    and nothing is said.
    """
    from scipy.ndimage import binary_dilation, label

    inside = one.faces
    if not one.spacing > 0.0:
        return 0.0
    cell = CELL * one.spacing
    # A free cell all around, so that what is outside is one.
    low = inside.min(axis=1) - cell
    height, width = (np.floor((inside.max(axis=1) - low) / cell) + 2.0).tolist()
    if height * width > MOST_CELLS:
        return 0.0

    def held(cloud: FloatArray) -> BoolArray:
        """Cells that hold points of the plane, (2, n)."""
        row, column = (np.floor((x - least) / cell) for x, least in zip(cloud, low, strict=True))
        on = (row >= 0.0) & (row < height) & (column >= 0.0) & (column < width)
        cells = np.zeros((int(height), int(width)), dtype=bool)
        cells.ravel()[(row * width + column)[on].astype(np.intp)] = True
        return cells

    own = held(inside)
    gaps, count = label(~own)
    sizes = np.bincount(gaps.ravel(), minlength=count + 1)
    # The first gap begins in a corner, outside; none is the number of what is held.
    sizes[[0, gaps[0, 0]]] = 0
    wide = np.flatnonzero(sizes >= FEWEST_CELLS)
    if not len(wide):
        return 0.0
    filled = np.bincount(gaps.ravel(), held(theirs.faces).ravel(), minlength=count + 1)
    closed = []
    for k in wide[filled[wide] >= FILLED * sizes[wide]]:
        hole = gaps == k
        around = binary_dilation(hole, iterations=SURROUNDING) & ~hole
        if own[around].mean() >= WHOLE:
            closed.append((int(sizes[k]), hole))
    if not closed:
        return 0.0
    heights = np.abs((other - plane.middle) @ plane.normal)
    beside = (heights >= within) & (heights < STANDING * cell)
    standing = held(((other[beside] - plane.middle) @ plane.across.T).T)
    widest = max((size for size, hole in closed if not (binary_dilation(hole) & standing).any()), default=0)
    return 2.0 * cell * float(np.sqrt(widest / np.pi))


def lifted(flat: FloatArray) -> FloatArray:
    """Points of a plane, (n, 2), in space, as trees take them."""
    return np.column_stack([flat, np.zeros(len(flat))])


def open_sides(at: FloatArray, flat: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Widest angle without a neighbour about points of a plane, (m, 2), and its direction, in radians.

    Shapes: flat (n, 2), of which rows (m, k) are the nearest to each point, itself the first.
    """
    (x, y), others = np.ascontiguousarray(flat.T), rows[:, 1:]
    angles = np.arctan2(np.take(y, others) - at[:, 1:], np.take(x, others) - at[:, :1])
    angles.sort(axis=1)
    # The first neighbour closes the round.
    closed = np.concatenate([angles, angles[:, :1] + 2.0 * np.pi], axis=1)
    gaps = np.diff(closed, axis=1)
    each, widest = np.arange(len(at)), gaps.argmax(axis=1)
    return gaps[each, widest], closed[each, widest] + 0.5 * gaps[each, widest]
