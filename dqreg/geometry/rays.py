"""What the rays of a scanner met, seen from a place amid it: the image that tells whether a scanner stood there."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray, median, quantile
from dqreg.geometry.angles import gaps_around
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows

# Points of a file that tell whether it is a sweep.
SWEEP_SAMPLE = 20_000
# Points count as behind or in front of what was seen from so many pixels on: surfaces may be seen at a grazing angle.
DEPTH_STEP_PIXELS = 4.0
# Around a LiDAR the far points are so many times as far as the near ones: 2.9 to 15 times in furnished rooms, where
# what it puts before the furniture tells the half-turn that the walls allow; bodies of which no side hides another came
# to 2.6 times.
FAR_TO_NEAR_RATIO = 2.8
# Rays of which it is asked how far the neighbours are that surround them, and neighbours that may.
ASKED_RAYS, MAX_NEIGHBOURS = 120, 65
# The widest angle that they leave; the share of the rays that must be surrounded.
OPEN_RAD, SURROUNDED_SHARE = np.deg2rad(120.0), 0.5
# Nearest neighbours that are tried, the fewest first.
NEIGHBOUR_COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
# Least edge of a pixel; beyond this sine rows are too short, and nothing is asked.
MIN_PIXEL_RAD, POLE_SINE = 3e-3, float(np.sin(np.deg2rad(75.0)))
# A point is apart from what rays met by so much of a pixel at least.
APART_PIXELS = 0.25
# A place is amid what it shows where the far points are `FAR_TO_NEAR_RATIO` times as far as the near ones. Where rays
# are as far apart in angle be they long or short, fewer times tell: the exponent of that is 0, and -1 of the points of
# a body, which are as far apart on its faces, as seen from inside.
FAR_TO_NEAR_RATIO_OF_EVEN_RAYS, EVEN_RAY_EXPONENT = 1.5, -0.5
# Ranges below this share of the largest are none.
MIN_RANGE_SHARE = 1e-6
# Points behind others in their own pixel at most, of scans from one place; by more than noise and slopes make, which is
# `DEPTH_STEP_PIXELS`.
MAX_HIDDEN_SHARE = 0.1


def is_sweep(points: FloatArray) -> bool:
    """Whether points, (n, 3), are what a LiDAR saw all about the origin of their frame.

    Its rays are as far apart in angle be they long or short, and hardly one ends behind another: of 416 scans of parts
    about places in and beside them one was taken for a sweep, of 56 sweeps of 16 to 128 rings all but four.
    """
    rays = Rays.of(points[:: max(1, len(points) // SWEEP_SAMPLE)], np.zeros(3), is_known=False)
    return rays is not None and rays.is_even


@dataclasses.dataclass(frozen=True, eq=False)
class Rays:
    """What the rays of a scanner met, in pixels of the sphere about it."""

    points: FloatArray  # (n, 3): Where they ended
    eye: FloatArray  # (3,)
    axes: FloatArray  # (3, 3): Those of the points' frame, in another order: the last is the pole
    pixel: float  # Edge, rad
    firsts: IntArray  # (r,): First pixel of each row
    columns: IntArray  # (r,): Pixels of each row
    nearest: FloatArray  # (p,): Least range in each; infinite where there is none
    farthest: FloatArray  # (p,)
    is_even: bool  # Whether they are as far apart in angle where they are long as where they are short

    @staticmethod
    def of(points: FloatArray, eye: FloatArray, *, is_known: bool) -> Rays | None:
        """Those to points, (n, 3), from a place that is known or likely; None where it is not amid what it shows."""
        arms = points - eye
        ranges = np.sqrt(np.einsum("ij,ij->i", arms, arms))
        is_any = ranges > MIN_RANGE_SHARE * ranges.max()
        points, arms, ranges = points[is_any], arms[is_any], ranges[is_any]
        directions = arms / ranges[:, None]
        pixel, exponent = _apart(directions, ranges)
        is_even = exponent > EVEN_RAY_EXPONENT
        far = quantile(ranges, 0.95) / quantile(ranges, 0.05)
        if not pixel > 0.0 or not far >= (FAR_TO_NEAR_RATIO_OF_EVEN_RAYS if is_even else FAR_TO_NEAR_RATIO):
            return None
        order = np.argsort(np.count_nonzero(np.abs(directions) > POLE_SINE, axis=0), kind="stable")[::-1]
        axes = np.eye(3)[order]
        pixel = max(pixel, MIN_PIXEL_RAD)
        heights = (np.arange(int(np.ceil(np.pi / pixel))) + 0.5) * pixel - 0.5 * np.pi
        columns = np.maximum((2.0 * np.pi / pixel * np.cos(heights)).astype(np.int64), 3)
        firsts = np.cumsum(columns) - columns
        nearest, farthest = np.full(columns.sum(), np.inf), np.zeros(columns.sum())
        behind = _filled(arms @ axes.T, ranges, pixel, firsts, columns, nearest, farthest)
        if not is_known and behind > MAX_HIDDEN_SHARE:
            return None
        return Rays(points, eye, axes, pixel, firsts, columns, nearest, farthest, is_even)

    def met(self, points: FloatArray, T: FloatArray, margin: float) -> IntArray:
        """Of points, (n, 3), moved by each of some poses, (k, 4, 4): how many are where, (k, 3); see `rays_met`."""
        from dqreg.kernels.evidence.ray_pixels import COUNTS, rays_met
        from dqreg.kernels.threads import as_plain, over_chunks

        turns, shifts = self.axes @ T[:, :3, :3], (T[:, :3, 3] - self.eye) @ self.axes.T
        counts = np.zeros((len(T), COUNTS), dtype=np.int64)
        image = self.pixel, self.firsts, self.columns, self.nearest, self.farthest
        asked = (
            as_plain(points),
            as_plain(turns),
            as_plain(shifts),
            *image,
            float(margin),
            APART_PIXELS * self.pixel,
            POLE_SINE,
        )
        over_chunks(rays_met, len(T), *asked, counts, chunk=1)
        return counts


def _apart(directions: FloatArray, ranges: FloatArray) -> tuple[float, float]:
    """How far the neighbours are that surround a ray, in the median, rad, and by which power of the range; 0 for none.

    Along a ring they are near; those that surround are of the next one too.
    """
    order = morton_order(directions)
    directions, ranges = np.take(directions, order, axis=0), ranges[order]
    if len(directions) <= MAX_NEIGHBOURS:
        return 0.0, 0.0
    rows = sample_rows(len(directions), ASKED_RAYS)
    neighbours, lengths = NeighbourTree(directions, in_order=True).nearest_to(rows, MAX_NEIGHBOURS)
    flat = _about(directions[rows], directions[neighbours])
    apart = np.full(len(rows), np.nan)
    towards = np.arctan2(flat[:, 1:, 1], flat[:, 1:, 0])
    for count in NEIGHBOUR_COUNTS[::-1]:
        gaps = gaps_around(towards[:, :count])[1].max(axis=1)
        apart = np.where(gaps < OPEN_RAD, lengths[:, count], apart)
    known = np.isfinite(apart)
    if np.mean(known) < SURROUNDED_SHARE:
        return 0.0, 0.0
    apart, ranges = apart[known], ranges[rows][known]
    far = ranges > median(ranges)
    if not far.any() or far.all():
        return 0.0, 0.0
    rise = np.log(median(apart[far]) / median(apart[~far])) / np.log(median(ranges[far]) / median(ranges[~far]))
    return float(median(apart)), float(rise)


def _about(directions: FloatArray, others: FloatArray) -> FloatArray:
    """Others, (m, k, 3), beside some directions, (m, 3), in two coordinates across each, (m, k, 2)."""
    aside = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    across = np.stack([aside, np.cross(directions, aside)], axis=1)
    return np.asarray(np.einsum("mij,mkj->mki", across, others - directions[:, None]))


def _filled(
    arms: FloatArray,
    ranges: FloatArray,
    pixel: float,
    firsts: IntArray,
    columns: IntArray,
    nearest: FloatArray,
    farthest: FloatArray,
) -> float:
    """Write the ranges in each pixel; the share of the points that are behind another one in theirs."""
    from dqreg.kernels.evidence.ray_pixels import fill_pixels
    from dqreg.kernels.threads import as_plain

    at = np.zeros(len(arms), dtype=np.int64)
    fill_pixels(as_plain(arms), float(pixel), firsts, columns, nearest, farthest, at)
    return float(np.mean(ranges > (1.0 + DEPTH_STEP_PIXELS * pixel) * nearest[at]))
