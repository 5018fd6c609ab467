"""Rims and holes of the faces of a cloud in a plane: where they are, and whether another cloud has them too."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows

# Points of a cloud at the pose, and a tree of them in their own frame, which is asked about its own points alone: those
# have the same neighbours at any pose.
Points = tuple[FloatArray, NeighbourTree]

# Neighbours of a point in space that tell whether its face lies in the plane, and the share of them that lie there.
BESIDE, MOSTLY = 8, 0.6
# Neighbours in the plane that leave so wide an angle without any about a point on a rim; a point that has them within
# so many times the usual distance only is on no face.
AROUND, SPARSE, OPEN_RAD = 20, 2.0, np.deg2rad(140.0)
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


@dataclasses.dataclass(frozen=True, eq=False)
class Faces:
    """Points of a cloud that lie in a plane, and how much of what is beside each does too."""

    rows: IntArray  # (n,): Of the cloud
    beside: IntArray  # (n, k): Rows of the neighbours in space, itself the first
    shares: FloatArray  # (n,): Of these, what lies in the plane

    @staticmethod
    def of(cloud: Points, plane: Plane, within: float) -> Faces:
        """Those of a cloud within a distance of a plane."""
        points, tree = cloud
        near = plane.holds(points, within)
        rows = np.flatnonzero(near)
        beside = tree.nearest_known(rows, BESIDE)
        return Faces(rows, beside, near[beside].mean(axis=1) if len(rows) else np.zeros(0))

    def flat(self, share: float = MOSTLY) -> IntArray:
        """Points whose faces lie in the plane, (m,): those of which more than a share of the neighbours does."""
        return self.rows[self.shares > share]


def rims_in(points: FloatArray, faces: Faces, plane: Plane, planes: Sequence[Plane]) -> Rims | None:
    """Rims of a cloud's faces in one of some planes; None where few of its points are."""
    held = faces.flat()
    if len(held) < FEWEST:
        return None
    across = plane.across
    flat = (points[held] - plane.middle) @ across.T
    tree = NeighbourTree(lifted(flat), in_order=True)
    usual = median(tree.nearest_to(sample_rows(len(flat), SAMPLE), AROUND + 1)[1][:, -1])
    rows = np.flatnonzero(~_is_inner(flat, faces, len(points)))
    found, apart = tree.nearest_to(rows, AROUND + 1)
    open_rad, towards = open_sides(flat[rows], flat, found)
    is_rim, spacing = (open_rad > OPEN_RAD) & (apart[:, -1] <= SPARSE * usual), usual * OF_SPACING
    points = points[held[rows[is_rim]]]
    counted = np.ones(len(points), dtype=bool)
    for other in planes:
        if other is not plane:
            counted &= ~other.holds(points, MEETING * spacing)
    outward = np.column_stack([np.cos(towards), np.sin(towards)])[is_rim] @ across
    return Rims(points, outward, counted, spacing)


def _is_inner(flat: FloatArray, faces: Faces, total: int) -> BoolArray:
    """Which points of faces in a plane, (m, 2), have others all around them next to them: they are on no rim, (m,)."""
    held = faces.shares > MOSTLY
    place = np.full(total, -1)
    place[faces.rows[held]] = np.arange(len(flat))
    beside = place[faces.beside[held]]
    # Those on no face in the plane close nothing: another takes their place.
    is_known = beside >= 0
    is_known[:, 0] = False
    each = np.arange(len(flat))
    beside = np.where(is_known, beside, beside[each, is_known.argmax(axis=1)][:, None])
    # Without any, these are the point itself.
    return np.asarray((open_sides(flat, flat, np.column_stack([each, beside]))[0] <= OPEN_RAD) & is_known.any(axis=1))


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
    rows, apart = NeighbourTree(other.points).nearest(one.points[asked], NEAREST)
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


def closed_hole(
    one: FloatArray, other: FloatArray, faces: tuple[Faces, Faces], plane: Plane, within: float, spacing: float
) -> float:
    """Diameter of the largest hole in a cloud's faces in a plane where another one's faces go on; 0 for none.

    Faces are of the two clouds, (n, 3), and spacing is that of the first one's points in the plane. A hole is a place
    without points that these enclose. Where anything of the other cloud stands beside it, that may hide the face from
    one side, and nothing is said.
    """
    from scipy.ndimage import binary_dilation, label

    across = plane.across
    inside = (one[faces[0].flat()] - plane.middle) @ across.T
    if not len(inside) or not spacing > 0.0:
        return 0.0
    cell = CELL * spacing
    # A free cell all around, so that what is outside is one.
    low = inside.min(axis=0) - cell
    shape = np.floor((inside.max(axis=0) - low) / cell).astype(np.intp) + 2
    if float(shape[0]) * float(shape[1]) > MOST_CELLS:
        return 0.0

    def held(cloud: FloatArray) -> BoolArray:
        """Cells that hold points of the plane, (n, 2)."""
        at: IntArray = np.floor((cloud - low) / cell).astype(np.intp)
        cells = np.zeros(shape, dtype=bool)
        cells[tuple(at[((at >= 0) & (at < shape)).all(axis=1)].T)] = True
        return cells

    own = held(inside)
    gaps, count = label(~own)
    face = held((other[faces[1].flat()] - plane.middle) @ across.T)
    heights = np.abs((other - plane.middle) @ plane.normal)
    beside = (heights >= within) & (heights < STANDING * cell)
    standing = held((other[beside] - plane.middle) @ across.T)
    sizes = np.bincount(gaps.ravel(), minlength=count + 1)
    filled = np.bincount(gaps.ravel(), face.ravel(), minlength=count + 1)
    widest = 0
    for k in np.flatnonzero((sizes >= FEWEST_CELLS) & (filled >= FILLED * sizes)):
        # The first gap begins in a corner, outside; none is the number of what is held.
        if k in (0, gaps[0, 0]):
            continue
        hole = gaps == k
        around = binary_dilation(hole, iterations=SURROUNDING) & ~hole
        if own[around].mean() >= WHOLE and not (binary_dilation(hole) & standing).any():
            widest = max(widest, int(sizes[k]))
    return 2.0 * cell * float(np.sqrt(widest / np.pi))


def lifted(flat: FloatArray) -> FloatArray:
    """Points of a plane, (n, 2), in space, as trees take them."""
    return np.column_stack([flat, np.zeros(len(flat))])


def open_sides(at: FloatArray, flat: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Widest angle without a neighbour about points of a plane, (m, 2), and its direction, in radians.

    Shapes: flat (n, 2), of which rows (m, k) are the nearest to each point, itself the first.
    """
    arms = flat[rows[:, 1:]] - at[:, None]
    angles = np.sort(np.arctan2(arms[..., 1], arms[..., 0]), axis=1)
    # The first neighbour closes the round.
    closed = np.concatenate([angles, angles[:, :1] + 2.0 * np.pi], axis=1)
    gaps = np.diff(closed, axis=1)
    each, widest = np.arange(len(at)), gaps.argmax(axis=1)
    return gaps[each, widest], closed[each, widest] + 0.5 * gaps[each, widest]
