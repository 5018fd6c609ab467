"""Other places that the fit alone does not tell apart: along a corridor, and one period on in a hall of columns.

A frame that slid along a corridor keeps most of its inliers, because floor and walls fit everywhere; the few points
that would tell are taken for outliers. So poses shifted along the weakest direction are compared point by point. Where
a frame is like itself elsewhere, the motion before decides, if it is known how long it is since the last frame.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Scan
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp import Alignment
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.self_similarity import FrameView
from dqreg.rigid import pose
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE
from dqreg.trust.records import Alternative, Reason

# Share of the correspondences' normals along the weakest direction: halls and streets reach 0.15 and more, a corridor
# 0.01, which edges and rings alone make. Below the first there may be rivals; below the second nothing holds it.
WEAK_NORMAL_SHARE, FREE_NORMAL_SHARE = 0.15, 0.03
# Shifts to either side, of the largest distance of a correspondence each; points that are compared at them.
SHIFTS_PER_SIDE, COMPARED_POINTS = 40, 300
# Least share of these that the map must hold at both poses.
MIN_SHARE_AT_BOTH_POSES = 0.2
# Cosine with an axis from which a normal faces it; fewer points tell nothing: a bare corridor has some at its edges.
FACING_COS, MIN_FACING_POINTS = 0.5, 200
# Normals that agree at least so well belong to one face; a difference of so many standard errors is one.
SAME_FACE_COS, SIGNIFICANT_SIGMAS = 0.7, 3.0
# Points of the map that are held against the frame's lines of sight, and those in view that say something.
VIEWED_MAP_POINTS, MIN_TELLING_POINTS = 4_000, 200


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedFrame:
    """A frame's pose after the poses along its weakest direction were compared."""

    aligned: Alignment
    axis: FloatArray  # (3,): weakest direction, map frame
    share: float  # Of the correspondences along it
    rivals: tuple[Alternative, ...] = ()  # Other poses that fit as well and could be meant
    is_escaped: bool = False  # Whether another pose along it explained the frame significantly better than the first
    looked_through: float = np.nan  # Share of the map's points in view that stand where the frame looked through
    doubts: tuple[Reason, ...] = ()  # What else speaks against it

    @property
    def is_weak(self) -> bool:
        """Whether a shift along the weakest direction could go unnoticed."""
        return self.share < WEAK_NORMAL_SHARE

    @property
    def is_refused(self) -> bool:
        """Whether its place may be another one: it looked through the map, turned unseen, or could as well lie there.

        What slides along a weak direction is in the map for want of better.
        """
        return self.looked_through > DEPTH_CONFLICT_SHARE or bool(self.doubts or (self.rivals and not self.is_weak))

    @property
    def is_free(self) -> bool:
        """Whether nothing holds the weakest direction."""
        return self.share < FREE_NORMAL_SHARE


def map_sample(surface: MapSurface) -> FloatArray:
    """Some points of the map, (n, 3)."""
    points = surface.points
    return np.take(points, sample_rows(len(points), VIEWED_MAP_POINTS), axis=0)


def looked_through(place: ComparedFrame, view: FrameView, standing: FloatArray) -> ComparedFrame:
    """The same with how much of some points of the map, (n, 3), stands where the frame looked through."""
    if not place.aligned.found:
        return place
    return dataclasses.replace(place, looked_through=share_looked_through(place.aligned, view, standing))


def share_looked_through(run: Alignment, view: FrameView, standing: FloatArray) -> float:
    """How much of some points of the map, (n, 3), stands where a frame looked through; NaN where few are in view."""
    nearer, alike = view.compared(standing, pose.inverse(run.T_target_source))
    return nearer / (nearer + alike) if nearer + alike >= MIN_TELLING_POINTS else np.nan


def placed(
    search: FrameSearch,
    frame: DownsampledFrame,
    aligned: Alignment,
    T_predicted: FloatArray,
    deviation: float,
    *,
    measured: bool,
) -> ComparedFrame:
    """The best of the poses along the weakest direction, and those that are no worse; infinite: no prediction.

    A prediction that was measured, with its covariance, decides between them.
    """
    axis, share = weakest(aligned)
    if not aligned.found or (share >= WEAK_NORMAL_SHARE and search.fits(aligned)):
        return ComparedFrame(aligned, axis, share)
    scan = frame.fitted
    rows = np.flatnonzero(scan.normals.any(axis=1))
    if len(rows) < COMPARED_POINTS // 10:
        return ComparedFrame(aligned, axis, share)
    compare = comparison_of(search, scan, _spread(rows))
    first, (shifts, scores) = aligned, compare.along(aligned.T_target_source, axis)
    if scores.min() < -SIGNIFICANT_SIGMAS:
        again = search.refine(scan, shifted(first.T_target_source, shifts[np.argmin(scores)] * axis))
        if again.found and compare.gain(again, first) < -SIGNIFICANT_SIGMAS:
            aligned = again
            shifts, scores = compare.along(aligned.T_target_source, axis)
    equal = _minima(scores) & (np.abs(shifts) > 0.5 * search.lengths.reach)
    poses = [shifted(aligned.T_target_source, shift * axis) for shift in shifts[equal]]
    # Constant velocity decides among equals, as far as it can.
    off = shift_between(aligned.T_target_source, T_predicted)
    nearer = [T for T in poses if shift_between(T, T_predicted) < 0.5 * off and off > deviation]
    if nearer:
        T = min(nearer, key=lambda T: shift_between(T, T_predicted))
        again = search.refine(scan, T)
        if compare.gain(again, aligned) < SIGNIFICANT_SIGMAS:
            poses = [
                *(T for T in poses if shift_between(T, again.T_target_source) > search.lengths.reach),
                aligned.T_target_source,
            ]
            aligned, off = again, shift_between(again.T_target_source, T_predicted)
    # How far the fit slid along what it leaves free says nothing against a sensor that measured the motion.
    limit = deviation if measured else max(2.0 * off, deviation)
    meant = [T for T in poses if shift_between(T, T_predicted) <= limit]
    axis, share = weakest(aligned)
    closer = dataclasses.replace(compare, rows=rows[faces(scan.normals[rows], aligned, axis)])
    rivals = tuple(Alternative(T, compare.rms(T)) for T in meant if _is_equal(search, closer, aligned, T))
    return ComparedFrame(aligned, axis, share, rivals, aligned is not first)


def comparison_of(search: FrameSearch, scan: Scan, rows: IntArray) -> RivalComparison:
    """Poses compared by some points of a frame."""
    return RivalComparison(search.surface, scan, rows, search.lengths.near, 0.5 * search.lengths.reach)


def faces(normals: FloatArray, aligned: Alignment, axis: FloatArray) -> BoolArray:
    """Which normals of a frame, (n, 3), face an axis of the map."""
    return np.asarray(np.abs(normals @ (aligned.T_target_source[:3, :3].T @ axis)) > FACING_COS)


def _is_equal(search: FrameSearch, compare: RivalComparison, aligned: Alignment, T: FloatArray) -> bool:
    """Whether a pose that fits as well on some of the points does so on all that face the axis between the two.

    It, or where the loop ends from it: of a few points on all faces those that tell are a few dozen. Others slide along
    their faces, and the rings of a LiDAR lie on themselves best where the sensor was before.
    """
    if len(compare.rows) < MIN_FACING_POINTS:
        return True
    here, there = compare.squares(aligned.T_target_source), search.refine(compare.scan, T)
    others = [T]
    # Rings hold a frame where it is: that the loop comes back says nothing.
    if there.found and shift_between(there.T_target_source, aligned.T_target_source) >= 0.5 * search.lengths.reach:
        others.append(there.T_target_source)
    return min(_significance(compare.squares(other) - here) for other in others) < SIGNIFICANT_SIGMAS


@dataclasses.dataclass(frozen=True, eq=False)
class RivalComparison:
    """How much worse the same points lie at another pose, in standard errors."""

    surface: MapSurface
    scan: Scan
    rows: IntArray
    cap: float
    gate: float

    def squares(self, T: FloatArray) -> FloatArray:
        """Truncated squared distances from the planes of the map, over the cap's; NaN where the map is empty."""
        found: FloatArray = self._squares(T, np.zeros((1, 3)))[0]
        return found

    def _squares(self, T: FloatArray, shifts: FloatArray) -> FloatArray:
        """The same at a pose and shifts of it, (k, 3): (k, n)."""
        points = (pose.apply(T, self.scan.points[self.rows]) + shifts[:, None]).reshape(-1, 3)
        normals = self.scan.normals[self.rows] @ T[:3, :3].T
        near = self.surface.closest(points)
        along = np.abs(np.einsum("ij,ij->i", points - near.points, near.normals))
        faces = near.normals.reshape(len(shifts), -1, 3)
        agree = np.abs(np.einsum("ij,kij->ki", normals, faces)).ravel() > SAME_FACE_COS
        squares = np.where(agree, np.minimum(along / self.cap, 1.0), 1.0) ** 2
        # Where the map holds nothing near, it was not looked at: that speaks neither for a pose nor against it.
        return np.where(near.distances < self.gate, squares, np.nan).reshape(len(shifts), -1)

    @property
    def shifts(self) -> FloatArray:
        """Shifts along an axis, (k,): none in the middle."""
        return np.asarray(self.cap * np.arange(-float(SHIFTS_PER_SIDE), SHIFTS_PER_SIDE + 1.0))

    def along(self, T: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Shifts along an axis, and how much worse each is than none."""
        shifts = self.shifts
        squares = self._squares(T, shifts[:, None] * axis)
        return shifts, np.array([_significance(each - squares[SHIFTS_PER_SIDE]) for each in squares])

    def explained(
        self, T: FloatArray, T_known: FloatArray, axis: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Shifts of a pose along an axis, and how much each explains of what a known pose does of the common points."""
        shifts = np.zeros(1) if axis is None else self.shifts
        there = 1.0 - self._squares(T, shifts[:, None] * (np.zeros(3) if axis is None else axis))
        here = 1.0 - self.squares(T_known)
        common = np.isfinite(here + there)
        known = np.where(common, here, 0.0).sum(axis=1)
        enough = (np.count_nonzero(common, axis=1) >= MIN_SHARE_AT_BOTH_POSES * len(here)) & (known > 0.0)
        there = np.where(common, there, 0.0).sum(axis=1)
        return shifts, np.where(enough, there / np.where(enough, known, 1.0), 0.0)

    def gain(self, one: Alignment, other: Alignment) -> float:
        """How much worse one pose is than another."""
        return _significance(self.squares(one.T_target_source) - self.squares(other.T_target_source))

    def rms(self, T: FloatArray) -> float:
        """Truncated root mean square distance."""
        return float(self.cap * np.sqrt(np.nanmean(self.squares(T))))


def _significance(difference: FloatArray) -> float:
    known = difference[np.isfinite(difference)]
    # Few common points say nothing of two poses; they are not taken for equals.
    if len(known) < MIN_SHARE_AT_BOTH_POSES * len(difference):
        return np.inf
    error = float(known.std()) / np.sqrt(len(known))
    return float(known.mean()) / error if error > 0.0 else 0.0


def weakest(aligned: Alignment) -> tuple[FloatArray, float]:
    """Direction that the fewest correspondences face, and their share."""
    values, vectors = np.linalg.eigh(normal_scatter(aligned))
    return vectors[:, 0], float(values[0])


def normal_scatter(aligned: Alignment) -> FloatArray:
    """Mean of the outer products of the correspondences' normals, (3, 3)."""
    normals = aligned.pairs.closest.normals
    weights = np.where(nonzero_rows(normals), aligned.weights, 0.0)
    return np.asarray((normals * weights[:, None]).T @ normals / max(float(weights.sum()), 1e-300))


def is_free(aligned: Alignment) -> bool:
    """Whether nothing holds a frame along its weakest direction."""
    return weakest(aligned)[1] < FREE_NORMAL_SHARE


def _minima(scores: FloatArray) -> BoolArray:
    """Where a shift is no worse than none, and better than its neighbours."""
    padded = np.pad(scores, 1, constant_values=np.inf)
    found: BoolArray = (scores < SIGNIFICANT_SIGMAS) & (scores <= padded[:-2]) & (scores <= padded[2:])
    return found


def _spread(rows: IntArray) -> IntArray:
    return rows[np.linspace(0, len(rows) - 1, min(COMPARED_POINTS, len(rows))).round().astype(np.int64)]


def shifted(T: FloatArray, by: FloatArray) -> FloatArray:
    """A pose displaced in the map."""
    moved = T.copy()
    moved[:3, 3] += by
    return moved


def shift_between(one: FloatArray, other: FloatArray) -> float:
    """How far two poses put the sensor apart."""
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
