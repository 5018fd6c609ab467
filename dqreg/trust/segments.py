"""Smooth segments of the scan: on the target, on other objects, or contradicting the pose.

Neighbouring points whose tangent planes agree are one segment. A segment that goes on beyond the target, or that lies
off it and meets a segment on it in a convex edge, where both end, is of the same body, and contradicts the pose. What
meets the part in a concave edge (a table, a clamp), goes on beyond it, or meets it nowhere is another object: the
convexity criterion of Stein et al. (2014), with the target's outward normals for the sign.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import PlaneFits, fit_planes_among, fit_planes_around

# Neighbours of a plane.
PLANE_NEIGHBOURS = 12
# Those that a point is linked with, within so many usual distances of them.
LINKED_NEIGHBOURS, LINK_SPACINGS = 8, 2.0
# Where less than this share of so many points is flat, the noise is large against their distances: then more of them.
# Of fewer points, it is the shape that is not flat.
FLAT_SHARE, MIN_NOISY_POINTS = 0.5, 4_000
NEIGHBOUR_COUNTS = PLANE_NEIGHBOURS, 2 * PLANE_NEIGHBOURS, 4 * PLANE_NEIGHBOURS
# A point whose neighbours leave their plane by more than this share of their extent is on an edge, or on no surface.
MAX_ROUGHNESS = 0.15
# Tangent planes agree within this angle,
SMOOTH_COS = np.cos(np.deg2rad(20.0))
# and with each point within this slope (and so many residuals) of the other's.
SMOOTH_SLOPE, SLOPE_RESIDUALS = 0.27, 2.0
# Segments of an edge differ by more than this angle; points of one then lie this slope below the plane of the other.
EDGE_COS, CONVEX_SLOPE = np.cos(np.deg2rad(35.0)), 0.2
# Normals of scan and target agree within this angle where a segment lies on the target.
AGREE_COS = np.cos(np.deg2rad(30.0))
# Points are off the target beyond so many widths within which they are on it.
OFF_WIDTHS = 2.0
# A segment continues where its points on the target are so many widths and distances of points from those off it: the
# rim of a table that passes under the part is not.
CONTINUATION_WIDTHS = 3.0
# Share of the points on the target that a larger segment holds from which on it goes on beneath it: of 41 parts on a
# table, at their right poses, none but those it merges with holds 0.006; a leg that is too long by a tenth 0.13.
BORROWED_SHARE = 0.05
# Most points of a level lie within so many widths of each other.
LEVEL_WIDTHS = 2.0
# The points at an edge belong to no segment: links over it are this many usual distances long at most.
EDGE_LINK_SPACINGS = 5.0
# A segment goes on above a plane where it has points within so many usual distances of where they meet, and as near to
# a place that much farther on.
THERE_SPACINGS, ABOVE_SPACINGS = 1.5, 2.5
# Points on the target, and off it, that say something.
MIN_SEGMENT_POINTS = 12
# Links over an edge that do, and the share of them that must be convex.
MIN_EDGE_LINKS, CONVEX_LINK_SHARE = 4, 0.75
# Most of a segment.
SEGMENT_SHARE = 0.7

# Neighbours of a point on the target, and those in its plane beyond the target from which on its face goes on; nothing
# farther off than that share of the target's size is beside it.
NEIGHBOURS_BESIDE, GOING_ON = 8, 2
IN_PLANE_SLOPE, BESIDE_DIAGONALS = 0.2, 0.5


@dataclasses.dataclass(frozen=True)
class Segments:
    """What the points of a scan lie on."""

    labels: IntArray  # (n,): Segment of each point; -1 on an edge or on no surface
    on: BoolArray  # (n,): The target
    contradicting: BoolArray  # (n,): The part's own surface, off the target
    other: BoolArray  # (n,): Other objects


def segments_of(
    points: FloatArray, normals: FloatArray, distances: FloatArray, width: float, size: float = np.inf
) -> Segments:
    """What placed points lie on, given the outward normal and the distance of a closed target at each of them.

    Points within the width are on the target; what reaches farther than its size, the diagonal, is no face of it.

    Shapes: points (n, 3), normals (n, 3), distances (n,).
    """
    sides = _Sides.of(points, normals, distances, width)
    larger = sides.larger_than(size)
    guilty = np.append(sides.continuing(larger) | (sides.beyond_convex_edges() & ~larger), False)
    contradicting = sides.off & guilty[sides.labels]
    return Segments(sides.labels, distances <= width, contradicting, sides.off & ~contradicting)


def smooth_segments(points: FloatArray) -> IntArray:
    """Smooth segment of each point, (n,), -1 on an edge or on no surface."""
    tree = NeighbourTree(points)
    fits, flat = _planes(tree, points)
    return _labelled(tree, points, np.nan_to_num(fits.normals), fits, flat)[0]


def share_going_on(points: FloatArray, normals: FloatArray, distances: FloatArray, width: float, size: float) -> float:
    """Share of placed points on a target, of a size, beside which the scan goes on in its plane; NaN for few.

    A part amid a scene ends where its faces end; a pose on a corner of something larger has its points in planes that
    go on. Segments tell so too, but only of dozens of points a face; here each point answers for itself.

    Given the normal of the target and its distance at each; within the width points are on it.

    Shapes: points (n, 3), normals (n, 3), distances (n,).
    """
    beside = np.flatnonzero(distances <= max(BESIDE_DIAGONALS * size, width))
    points, normals, distances = (np.take(x, beside, axis=0) for x in (points, normals, distances))
    on = np.flatnonzero(distances <= width)
    if len(on) < MIN_SEGMENT_POINTS:
        return np.nan
    found, apart = NeighbourTree(points).nearest(points[on], min(NEIGHBOURS_BESIDE + 1, len(points)))
    # Where many points are at one place, a point is not its own first neighbour.
    towards = points[found] - points[on][:, None]
    heights = np.abs(np.einsum("ijk,ik->ij", towards, normals[on]))
    in_plane = heights <= np.minimum(width, IN_PLANE_SLOPE * apart)
    going_on = np.count_nonzero(in_plane & (distances[found] > OFF_WIDTHS * width), axis=1)
    return float(np.mean(going_on >= GOING_ON))


@dataclasses.dataclass(frozen=True)
class _Sides:
    """Segments, and which of their points are on the target and off it."""

    points: FloatArray
    own: FloatArray  # (n, 3): Normals of the scan
    normals: FloatArray  # (n, 3): Those of the target
    spacing: FloatArray  # (n,): Distance to the usual neighbour
    labels: IntArray  # (n,): Segment of each point; -1 on an edge or on no surface
    on: BoolArray  # (n,): On the target, with a normal that agrees
    off: BoolArray  # (n,): On a surface off the target
    width: float

    @staticmethod
    def of(points: FloatArray, normals: FloatArray, distances: FloatArray, width: float) -> _Sides:
        tree = NeighbourTree(points)
        fits, flat = _planes(tree, points)
        own = np.nan_to_num(fits.normals)
        labels, spacing = _labelled(tree, points, own, fits, flat)
        on = (distances <= width) & flat & (np.abs(np.einsum("ij,ij->i", own, normals)) > AGREE_COS)
        off = (distances > np.maximum(OFF_WIDTHS * width, spacing)) & flat
        return _Sides(points, own, normals, spacing, labels, on, off, width)

    def counted(self, points: BoolArray) -> IntArray:
        """Points of each segment among some, (segments,)."""
        return np.bincount(self.labels[points & (self.labels >= 0)], minlength=self.labels.max(initial=-1) + 1)

    def continuing(self, larger: BoolArray) -> BoolArray:
        """Segments that lie on the target and go on beyond it, given which are larger than it, (segments,)."""
        count = self.counted(self.on)
        found = (self.counted(self.off) >= MIN_SEGMENT_POINTS) & (count >= MIN_SEGMENT_POINTS)
        # Of a table that holds some of the target's points none is of the target, be they rows beside its rim.
        borrowed = larger & (count >= BORROWED_SHARE * count.sum()) & (count < SEGMENT_SHARE * count.sum())
        for segment in np.flatnonzero(found):
            on, off = (np.flatnonzero(side & (self.labels == segment)) for side in (self.on, self.off))
            apart = NeighbourTree(self.points[off]).nearest(self.points[on], 1)[1][:, 0]
            clear = apart > CONTINUATION_WIDTHS * (self.width + self.spacing[on])
            is_clear = np.count_nonzero(clear) >= MIN_SEGMENT_POINTS or borrowed[segment]
            found[segment] = is_clear and not self._is_step(on, off)
        return found

    def _is_step(self, on: IntArray, off: IntArray) -> bool:
        """Whether points on and off the target lie in two parallel planes: a table under a part that is thin.

        Where points stand farther apart than the planes, links go from one to the other.
        """
        points = self.points[off]
        normal = np.linalg.eigh(np.cov(points.T))[1][:, 0]
        heights = [self.points[rows] @ normal - np.median(points @ normal) for rows in (on, off)]
        low, middle, high = np.quantile(heights[0], (0.1, 0.5, 0.9))
        is_flat = max(high - low, 2.0 * np.quantile(np.abs(heights[1]), 0.9)) <= LEVEL_WIDTHS * self.width
        return bool(is_flat and abs(middle) > CONTINUATION_WIDTHS * self.width)

    def larger_than(self, size: float) -> BoolArray:
        """Segments with two points farther apart than a length, (segments,): along one of the axes, at least."""
        known = np.flatnonzero(self.labels >= 0)
        known = known[np.argsort(self.labels[known], kind="stable")]
        found, starts = np.unique(self.labels[known], return_index=True)
        large = np.zeros(self.labels.max(initial=-1) + 1, dtype=bool)
        if len(found):
            points = self.points[known]
            extents = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
            large[found] = extents.max(axis=1) > size
        return large

    def beyond_convex_edges(self) -> BoolArray:
        """Segments off the target that meet segments on it in a convex edge, (segments,)."""
        whole, count_on, count_off = self.counted(self.labels >= 0), self.counted(self.on), self.counted(self.off)
        is_on, is_off = (
            (count >= MIN_SEGMENT_POINTS) & (count > SEGMENT_SHARE * whole) for count in (count_on, count_off)
        )
        a, b = (np.flatnonzero((self.labels >= 0) & np.append(side, False)[self.labels]) for side in (is_on, is_off))
        on = np.flatnonzero(self.on)
        if not len(a) or not len(b):
            return np.zeros(len(whole), dtype=bool)
        found, apart = NeighbourTree(self.points[b]).nearest(self.points[a], 4)
        one, two, apart = np.repeat(a, found.shape[1]), b[found.ravel()], apart.ravel()
        near = apart <= EDGE_LINK_SPACINGS * np.minimum(self.spacing[one], self.spacing[two])
        near &= np.abs(np.einsum("ij,ij->i", self.own[one], self.own[two])) < EDGE_COS
        one, two, apart = one[near], two[near], apart[near]
        # Where a face runs on beyond the target, its outward side is that of its nearest point on it.
        outward = self.normals[on[NeighbourTree(self.points[on]).nearest(self.points[one], 1)[0][:, 0]]]
        side = np.sign(np.einsum("ij,ij->i", outward, self.own[one]))
        up = side[:, None] * self.own[one]
        height = np.einsum("ij,ij->i", up, self.points[two] - self.points[one])
        below = height < -CONVEX_SLOPE * apart
        below[below] &= ~self._go_on_above(two[below], up[below], height[below], b)
        convex, concave = (
            np.bincount(self.labels[two[side]], minlength=len(whole))
            for side in (below, ~below & (np.abs(height) > CONVEX_SLOPE * apart))
        )
        # An edge is about as long as the root of the number of points on the face behind it.
        return (convex >= np.maximum(MIN_EDGE_LINKS, np.sqrt(count_off))) & (
            convex >= CONVEX_LINK_SHARE * (convex + concave)
        )

    def _go_on_above(self, two: IntArray, up: FloatArray, height: FloatArray, b: IntArray) -> BoolArray:
        """Which points below planes, (k,), are of segments that go on above these, where they meet them.

        Faces of one body end where they meet in a convex edge; a table beyond the rim of a face goes on. Given the
        points of those segments, and the normals of the planes and the heights of the points over them.
        """
        own, spacing = self.own[two], self.spacing[two]
        climb = up - np.einsum("ij,ij->i", up, own)[:, None] * own
        steepness = np.linalg.norm(climb, axis=1)
        climb /= steepness[:, None]
        meet = self.points[two] + (-height / steepness)[:, None] * climb
        tree, goes_on = NeighbourTree(self.points[b]), np.ones(len(two), dtype=bool)
        for place in (meet, meet + (ABOVE_SPACINGS * spacing)[:, None] * climb):
            found, apart = tree.nearest(place, 1)
            goes_on &= (apart[:, 0] <= THERE_SPACINGS * spacing) & (self.labels[b[found[:, 0]]] == self.labels[two])
        return goes_on


def _planes(tree: NeighbourTree, points: FloatArray) -> tuple[PlaneFits, BoolArray]:
    """Planes about all points, and which of these are flat; of more neighbours where noise makes few of them flat."""
    rows = np.arange(len(points))
    for count in NEIGHBOUR_COUNTS:
        if count == PLANE_NEIGHBOURS:
            fits = fit_planes_around(tree, points, rows, PLANE_NEIGHBOURS)
        else:
            fits = fit_planes_among(points, tree.nearest(points, min(count, len(points)))[0].astype(np.int64))
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.nan_to_num(fits.residuals / np.sqrt(fits.lever), nan=np.inf) < MAX_ROUGHNESS
        if np.mean(flat) >= FLAT_SHARE or len(points) < MIN_NOISY_POINTS:
            break
    return fits, flat


def _labelled(
    tree: NeighbourTree, points: FloatArray, own: FloatArray, fits: PlaneFits, flat: BoolArray
) -> tuple[IntArray, FloatArray]:
    """Segment of each point, -1 for those that are not flat, and the distance to the usual neighbour, (n,) each."""
    # Not SciPy's: to import its graphs takes 50 ms of the first registration, which may have a time limit.
    from dqreg.kernels.clouds.components import components

    indices = tree.around(np.arange(len(points)))[0][:, 1 : LINKED_NEIGHBOURS + 1].astype(np.int64)
    one, two = np.repeat(np.arange(len(points)), indices.shape[1]), indices.ravel()
    apart = points[two] - points[one]
    lengths = np.sqrt(np.einsum("ij,ij->i", apart, apart))
    spacing = np.median(lengths.reshape(indices.shape), axis=1)
    linked = (lengths <= LINK_SPACINGS * np.minimum(spacing[one], spacing[two])) & flat[one] & flat[two]
    one, two, apart, lengths = one[linked], two[linked], apart[linked], lengths[linked]
    aside = np.maximum(*(np.abs(np.einsum("ij,ij->i", own[k], apart)) for k in (one, two)))
    smooth = aside <= SMOOTH_SLOPE * lengths + SLOPE_RESIDUALS * np.maximum(fits.residuals[one], fits.residuals[two])
    smooth &= np.abs(np.einsum("ij,ij->i", own[one], own[two])) > SMOOTH_COS
    labels = components(len(points), one[smooth], two[smooth])
    return np.where(flat, labels, -1), spacing
