"""Other places that the fit alone does not tell apart: along a corridor, and one period on in a hall of columns.

A frame that slid along a corridor keeps most of its inliers, because floor and walls fit everywhere; the few points
that would tell are taken for outliers. So poses shifted along the weakest direction are compared point by point. Where
a frame is like itself elsewhere, the motion before decides, if it is known how long it is since the last frame.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, product
from dqreg.geometry import Scan
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp import Alignment
from dqreg.kernels.threads import Later
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.self_similarity import CONTRADICTED_SHARE, ROUGH_SHARE, FrameView, behind_faces, self_similar_shifts
from dqreg.rigid import pose
from dqreg.solvers.motion_words import Vector, direction_words
from dqreg.trust.records import Alternative

# Share of the correspondences' normals along the weakest direction: halls and streets reach 0.15 and more, a corridor
# 0.01, which edges and rings alone make. Below the first there may be rivals; below the second nothing holds it.
WEAK_NORMAL_SHARE, FREE_NORMAL_SHARE = 0.15, 0.03
# Share of a frame's points whose normals the map has to know, for those of its own to be needless.
MIN_KNOWN_NORMAL_SHARE = 2.0 / 3.0
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
# Voxels that the refinement of a place one period on may move it, and such places that are named.
MAX_REFINEMENT_CELLS, MAX_NAMED_POSES = 3.0, 2


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedFrame:
    """A frame's pose after the poses along its weakest direction were compared."""

    aligned: Alignment
    axis: FloatArray  # (3,): weakest direction, map frame
    share: float  # Of the correspondences along it
    rivals: tuple[Alternative, ...] = ()  # Other poses that fit as well and could be meant
    is_escaped: bool = False  # Whether another pose along it explained the frame significantly better than the first
    looked_through: float = np.nan  # Share of the map's points in view that stand where the frame looked through

    @property
    def is_weak(self) -> bool:
        """Whether a shift along the weakest direction could go unnoticed."""
        return self.share < WEAK_NORMAL_SHARE

    @property
    def is_free(self) -> bool:
        """Whether nothing holds the weakest direction."""
        return self.share < FREE_NORMAL_SHARE


def map_sample(surface: MapSurface) -> FloatArray:
    """Some points of the map, (n, 3)."""
    points = surface.points
    return points[sample_rows(len(points), VIEWED_MAP_POINTS)]


def compared_with_rivals(
    place: ComparedFrame,
    search: FrameSearch,
    frame: DownsampledFrame,
    seen: Later[FrameView],
    standing: FloatArray,
    similar: Later[FloatArray] | None,
) -> ComparedFrame:
    """The same with what speaks against it: what the frame looked through, and places where it is like itself.

    Those are asked for where nothing else excludes them: without times, frames may be missing, and constant velocity
    does not.
    """
    if not place.aligned.found:
        return place
    T, view = place.aligned.T_target_source, seen.result()
    nearer, alike = view.compared(standing, pose.inverse(T))
    if nearer + alike >= MIN_TELLING_POINTS:
        place = dataclasses.replace(place, looked_through=nearer / (nearer + alike))
    if similar is None or place.rivals:
        return place
    scan, shifts = with_met_normals(frame, place.aligned), similar.result()
    if not any(_could_repeat(scan, view, shift) for shift in shifts):
        return place
    # Rare, and worth normals of its own.
    own = frame.fitted
    shifts = shifts if scan is own else similar_shifts(search, own)
    return dataclasses.replace(place, rivals=_repeated(search, own, place.aligned, view, shifts))


def with_met_normals(frame: DownsampledFrame, aligned: Alignment) -> Scan:
    """A frame with the normals of the planes that it met, which cost nothing; with its own where too few met any."""
    met = aligned.pairs.closest.normals
    if len(met) != len(frame.seen) or np.count_nonzero(nonzero_rows(met)) < MIN_KNOWN_NORMAL_SHARE * len(met):
        return frame.fitted
    return dataclasses.replace(frame.scan, normals=product(met, aligned.T_target_source[:3, :3]))


def similar_shifts(search: FrameSearch, scan: Scan) -> FloatArray:
    """Shifts that put a frame onto itself, (k, 3)."""
    return self_similar_shifts(scan.points, scan.normals, search.lengths.voxel_size, 0.5 * search.lengths.reach)


def _could_repeat(scan: Scan, view: FrameView, shift: FloatArray) -> bool:
    """Whether a frame could have been seen at the end of a shift as well."""
    step = pose.from_parts(np.eye(3), shift)
    return not behind_faces(scan.points, scan.normals, shift) and view.repeats(scan, step, ROUGH_SHARE)


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
    axis, share = _weakest(aligned)
    if not aligned.found or (share >= WEAK_NORMAL_SHARE and search.fits(aligned)):
        return ComparedFrame(aligned, axis, share)
    scan = frame.fitted
    rows = np.flatnonzero(scan.normals.any(axis=1))
    if len(rows) < COMPARED_POINTS // 10:
        return ComparedFrame(aligned, axis, share)
    compare = _RivalComparison(search.surface, scan, _spread(rows), search.lengths.near, 0.5 * search.lengths.reach)
    first, (shifts, scores) = aligned, compare.along(aligned.T_target_source, axis)
    if scores.min() < -SIGNIFICANT_SIGMAS:
        again = search.refine(scan, _shifted(first.T_target_source, shifts[np.argmin(scores)] * axis))
        if again.found and compare.gain(again, first) < -SIGNIFICANT_SIGMAS:
            aligned = again
            shifts, scores = compare.along(aligned.T_target_source, axis)
    equal = _minima(scores) & (np.abs(shifts) > 0.5 * search.lengths.reach)
    poses = [_shifted(aligned.T_target_source, shift * axis) for shift in shifts[equal]]
    # Constant velocity decides among equals, as far as it can.
    off = _off(aligned.T_target_source, T_predicted)
    nearer = [T for T in poses if _off(T, T_predicted) < 0.5 * off and off > deviation]
    if nearer:
        T = min(nearer, key=lambda T: _off(T, T_predicted))
        again = search.refine(scan, T)
        if compare.gain(again, aligned) < SIGNIFICANT_SIGMAS:
            poses = [
                *(T for T in poses if _off(T, again.T_target_source) > search.lengths.reach),
                aligned.T_target_source,
            ]
            aligned, off = again, _off(again.T_target_source, T_predicted)
    # How far the fit slid along what it leaves free says nothing against a sensor that measured the motion.
    limit = deviation if measured else max(2.0 * off, deviation)
    meant = [T for T in poses if _off(T, T_predicted) <= limit]
    axis, share = _weakest(aligned)
    towards = np.abs(scan.normals[rows] @ (aligned.T_target_source[:3, :3].T @ axis)) > FACING_COS
    closer = dataclasses.replace(compare, rows=rows[towards])
    rivals = tuple(Alternative(T, compare.rms(T)) for T in meant if _is_equal(search, closer, aligned, T))
    return ComparedFrame(aligned, axis, share, rivals, aligned is not first)


def _is_equal(search: FrameSearch, compare: _RivalComparison, aligned: Alignment, T: FloatArray) -> bool:
    """Whether a pose that fits as well on some of the points does so on all that face the axis between the two.

    It, or where the loop ends from it: of a few points on all faces those that tell are a few dozen. Others slide along
    their faces, and the rings of a LiDAR lie on themselves best where the sensor was before.
    """
    if len(compare.rows) < MIN_FACING_POINTS:
        return True
    here, there = compare.squares(aligned.T_target_source), search.refine(compare.scan, T)
    others = [T]
    # Rings hold a frame where it is: that the loop comes back says nothing.
    if there.found and _off(there.T_target_source, aligned.T_target_source) >= 0.5 * search.lengths.reach:
        others.append(there.T_target_source)
    return min(_significance(compare.squares(other) - here) for other in others) < SIGNIFICANT_SIGMAS


def _repeated(
    search: FrameSearch, scan: Scan, aligned: Alignment, view: FrameView, shifts: FloatArray
) -> tuple[Alternative, ...]:
    """Poses where the frame is like itself: what stands there was seen here, and nothing where it looked through."""
    cell, least, T = search.lengths.voxel_size, 0.5 * search.lengths.reach, aligned.T_target_source
    found: list[Alternative] = []
    for shift in shifts:
        if not _could_repeat(scan, view, shift):
            continue
        step = pose.from_parts(np.eye(3), shift)
        # Known to a cell: begun farther off, a frame that overlaps by little would slide along what does not hold it.
        run = search.settle(scan, T @ step, aligned)
        if not run.found:
            continue
        there = run.T_target_source
        away, known = _off(there, T), [aligned.T_target_source, *(other.T_target_source for other in found)]
        if _off(there, T @ step) > MAX_REFINEMENT_CELLS * cell or min(_off(there, other) for other in known) < least:
            continue
        if view.repeats(scan, pose.inverse(T) @ there, CONTRADICTED_SHARE):
            rms = np.sqrt(np.mean(search.surface.distances(pose.apply(there, scan.points)) ** 2))
            words = f"{away:.3g} along {direction_words(_axis(there[:3, 3] - T[:3, 3]))}"
            found.append(Alternative(there, float(rms), words=words))
        if len(found) == MAX_NAMED_POSES:
            break
    return tuple(found)


@dataclasses.dataclass(frozen=True, eq=False)
class _RivalComparison:
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

    def along(self, T: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Shifts along an axis, and how much worse each is than none."""
        shifts: FloatArray = self.cap * np.arange(-float(SHIFTS_PER_SIDE), SHIFTS_PER_SIDE + 1.0)
        squares = self._squares(T, shifts[:, None] * axis)
        return shifts, np.array([_significance(each - squares[SHIFTS_PER_SIDE]) for each in squares])

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


def _weakest(aligned: Alignment) -> tuple[FloatArray, float]:
    """Direction that the fewest correspondences face, and their share."""
    normals = aligned.pairs.closest.normals
    weights = np.where(nonzero_rows(normals), aligned.weights, 0.0)
    values, vectors = np.linalg.eigh((normals * weights[:, None]).T @ normals / max(float(weights.sum()), 1e-300))
    return vectors[:, 0], float(values[0])


def _minima(scores: FloatArray) -> BoolArray:
    """Where a shift is no worse than none, and better than its neighbours."""
    padded = np.pad(scores, 1, constant_values=np.inf)
    found: BoolArray = (scores < SIGNIFICANT_SIGMAS) & (scores <= padded[:-2]) & (scores <= padded[2:])
    return found


def _spread(rows: IntArray) -> IntArray:
    return rows[np.linspace(0, len(rows) - 1, min(COMPARED_POINTS, len(rows))).round().astype(np.int64)]


def _shifted(T: FloatArray, by: FloatArray) -> FloatArray:
    moved = T.copy()
    moved[:3, 3] += by
    return moved


def _axis(step: FloatArray) -> Vector:
    x, y, z = (step / np.linalg.norm(step)).tolist()
    return x, y, z


def _off(one: FloatArray, other: FloatArray) -> float:
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
