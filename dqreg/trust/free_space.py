"""Free space: what a scanner looked through speaks against a surface that a pose puts there."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds, median, quantile
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.rays import DEPTH_STEP_PIXELS, FAR_TO_NEAR_RATIO
from dqreg.geometry.spacing import measure_spacing
from dqreg.geometry.vector_rows import cross

# Rows that a thread takes in one go: after each it asks for the interpreter, which others may be at.
TOGETHER = 16_384
# Edge of a pixel in distances of neighbouring points, and pixels a side at most.
PIXEL_SPACINGS, MAX_PIXELS = 1.5, 1_000
# The origin of a cloud is taken for the scanner's place where at most this share of the points is behind others from
# there: depth cameras came to 0.029, LiDARs to 0.04, several sides of a body to 0.06 and more,
MAX_HIDDEN_FROM_ORIGIN = 0.045
# and it lies that share of the size outside of the points, or is amid them, see `FAR_TO_NEAR_RATIO`.
MIN_DISTANCE_OUTSIDE = 0.15
# Points of which the distance to the nearest is asked: their median is good to two per cent.
SPACING_SAMPLE = 1_000
# Points compared that say something.
MIN_COMPARED = 200
# Points of a scan that are looked at from its viewpoint, and the share of them that may stand behind others: up to 0.07
# from where scanners stood, 0.06 to 0.4 from beside, where some scans show it and others do not.
VIEWPOINT_POINTS, MAX_HIDDEN_SHARE = 3_000, 0.12


@dataclasses.dataclass(frozen=True)
class DepthImage:
    """Ranges to a cloud by azimuth and elevation about a viewpoint."""

    eye: FloatArray  # (3,)
    axes: FloatArray  # (3, 3): Rows are right, up, and the line of sight
    pixel: float  # Edge, radians
    low: FloatArray  # (2,): Corner of the image
    nearest: FloatArray  # (h, w): Range of the nearest point in each pixel and those around it
    filled: BoolArray  # (h, w): Pixels that hold a point
    behind: float  # Share of the points that stand behind others

    @staticmethod
    def of(points: FloatArray, eye: FloatArray, pixel: float | None = None) -> DepthImage:
        """Image of points, (n, 3), from a viewpoint, (3,); the edge of a pixel is measured where none is given."""
        from dqreg.kernels.evidence.depth_pixels import count_behind, fill_nearest, least_around

        # The bits of the mean along columns in a quarter of the time.
        axes = _looking(np.einsum("ij->j", points) / len(points) - eye)
        places, ranges = _project(points, axes, eye)
        low, high = places.min(axis=1), places.max(axis=1)
        least = max(float((high - low).max()) / MAX_PIXELS, np.finfo(float).eps)
        pixel = max(PIXEL_SPACINGS * _spacing(places) if pixel is None else pixel, least)
        low = low - 1.5 * pixel
        height, width = ((high - low) / pixel).astype(np.int64) + 3
        image, at = np.full((height, width), np.inf), np.zeros(len(points), dtype=np.int64)
        fill_nearest(places, ranges, low, float(pixel), image, at)
        behind = count_behind(ranges, image, at, float(1.0 + DEPTH_STEP_PIXELS * pixel)) / len(points)
        least_around(image, nearest := np.zeros(image.shape))
        return DepthImage(eye, axes, pixel, low, nearest, np.isfinite(image), behind)

    def compared(self, points: FloatArray, margin: float, step: float = DEPTH_STEP_PIXELS) -> tuple[int, int]:
        """Points nearer than what was seen there by more than a margin and a step of so many pixels, and those as far.

        Points behind it say nothing, nor do those where nothing was seen.
        """
        from dqreg.kernels.evidence.depth_pixels import count_before
        from dqreg.kernels.threads import as_plain

        counts, limits = np.zeros(2, dtype=np.int64), (float(margin), float(step))
        points, axes, eye, low = (as_plain(each) for each in (points, self.axes, self.eye, self.low))
        count_before(points, axes, eye, low, float(self.pixel), self.nearest, self.filled, *limits, counts)
        return int(counts[0]), int(counts[1])

    def sides_of(self, points: FloatArray, margin: float, step: float) -> IntArray:
        """The same of each point, (n,): 1 for nearer, -1 for as far, 0 where nothing is said."""
        places, ranges = _project(points, self.axes, self.eye)
        at = np.floor((places.T - self.low) / self.pixel).astype(np.int64)
        inside: BoolArray = np.all((at >= 0) & (at < self.filled.shape), axis=1)
        row, column = np.where(inside[:, None], at, 0).T
        known = inside & self.filled[row, column]
        limit = margin + step * self.pixel * ranges
        nearer = np.where(known, self.nearest[row, column], -np.inf) - ranges
        return (nearer > limit).astype(np.int64) - (np.abs(nearer) <= limit)


@dataclasses.dataclass(frozen=True)
class Seen:
    """Points of one side, (n, 3), and where the scanner stood, if that is known; the origin of its frame else."""

    points: FloatArray
    viewpoint: FloatArray | None
    origin: FloatArray
    one_place: bool = True  # Whether a scanner saw all of it from one place: the origin is none of several

    @cached_property
    def spacing(self) -> float:
        """Distance between neighbouring points."""
        return measure_spacing(NeighbourTree(self.points, in_order=True), self.points, SPACING_SAMPLE)

    @cached_property
    def image(self) -> DepthImage | None:
        """What the scanner saw; None where its place is neither known nor likely."""
        if self.viewpoint is not None:
            return DepthImage.of(self.points, self.viewpoint)
        if not self.one_place:
            return None
        low, high = bounds(self.points)
        outside = np.linalg.norm(np.maximum(np.maximum(low - self.origin, self.origin - high), 0.0))
        arms = self.points - self.origin
        ranges = np.sqrt(np.einsum("ij,ij->i", arms, arms))
        near, far = quantile(ranges, 0.05), quantile(ranges, 0.95)
        if not outside >= MIN_DISTANCE_OUTSIDE * np.linalg.norm(high - low) and not far >= FAR_TO_NEAR_RATIO * near:
            return None
        image = DepthImage.of(self.points, self.origin)
        return image if image.behind <= MAX_HIDDEN_FROM_ORIGIN else None


def looked_through(source: Seen, target: Seen, T_target_source: FloatArray, gaps: float) -> float:
    """Share of the compared points of two clouds that stand where the other one's scanner looked through.

    Nearer than so many spacings is as far. NaN where no scanner's place is known: both origins must be likely ones, or
    one viewpoint given.
    """
    if not can_look_through(source, target):
        return np.nan
    images, margin = (source.image, target.image), gaps * max(source.spacing, target.spacing)
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    nearer = alike = 0
    for image, points in zip(images, ((target.points - t) @ R, source.points @ R.T + t), strict=True):
        if image is not None:
            counts = image.compared(points, margin)
            nearer, alike = nearer + counts[0], alike + counts[1]
    return nearer / (nearer + alike) if nearer + alike >= MIN_COMPARED else np.nan


def can_look_through(source: Seen, target: Seen) -> bool:
    """Whether a scanner's place is known; what is asked at every pose is made then."""
    is_known = source.viewpoint is not None or target.viewpoint is not None
    # The target's first: it is known where another scan was registered to it.
    if not is_known and (target.image is None or source.image is None):
        return False
    _ = source.image, target.image, source.spacing, target.spacing
    return True


def hidden_share(points: FloatArray, viewpoint: FloatArray) -> float:
    """Share of the points of a scan, (n, 3), that stand behind others, seen from a viewpoint; 0 where that is open."""
    some = points[:: max(1, len(points) // VIEWPOINT_POINTS)]
    some = some[np.isfinite(some).all(axis=1)]
    if len(some) < MIN_COMPARED or not (some != viewpoint).any(axis=1).all():
        return 0.0
    return DepthImage.of(some, viewpoint).behind


def _project(points: FloatArray, axes: FloatArray, eye: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Azimuth and elevation, (2, n), and range, (n,)."""
    from dqreg.kernels.evidence.depth_pixels import directions_from
    from dqreg.kernels.threads import as_plain, over_chunks

    places, ranges = np.zeros((2, len(points))), np.zeros(len(points))
    columns = as_plain(points), as_plain(axes), as_plain(eye), places, ranges
    over_chunks(directions_from, len(points), *columns, chunk=TOGETHER)
    return places, ranges


def _spacing(places: FloatArray) -> float:
    flat = np.column_stack([*places, np.zeros(places.shape[1])])
    flat = np.take(flat, morton_order(flat), axis=0)
    return float(
        median(NeighbourTree(flat, in_order=True).nearest_to(sample_rows(len(flat), SPACING_SAMPLE), 4)[1][:, -1])
    )


def _looking(sight: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(sight))
    sight = sight / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    right = cross(sight, np.eye(3)[np.argmin(np.abs(sight))])
    right /= np.linalg.norm(right)
    return np.stack([right, cross(sight, right), sight])
