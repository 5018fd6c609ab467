"""Deskewing: the motion during a sweep is removed with the last motion first, then with the one that was found.

KISS-ICP takes the last frame's motion. Where the sensor has just changed its motion, that distorts the frame. So the
motion is asked of the sweep itself: what was seen early and what was seen late must fit the map both.

The way from the last pose would not do: a motion that is off by d shifts the pose at the end of its sweep by about d/2,
and with it the motion of the next frame by as much with the other sign. Made to agree, that never dies away.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_pose, product, require_finite
from dqreg.errors import InputError
from dqreg.icp import Alignment
from dqreg.kernels.threads import Later
from dqreg.odometry.align import MIN_POINTS_FOR_CELLS, POINTS_BEFORE_SWEEP, FrameSearch
from dqreg.odometry.assess import LOST_FRACTION
from dqreg.odometry.follow import SweptFrame, is_in_cells, off_at
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.starts import predict
from dqreg.odometry.sweep import swept
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.rigid import Trajectory, pose, twist
from dqreg.rigid.single_pose import orthonormal
from dqreg.rigid.twist import scaling_by
from dqreg.trust.records import Reason

# The frame is deskewed again while the motion is wrong by this fraction of a voxel at the frame's edge, and so many
# times at most.
REPEATED_MISFIT_VOXELS, MAX_ROUNDS = 0.3, 5
# Share of the correspondences that has to face a motion for it to count: at this share, half of it is believed in a
# round, of which there are few, each after a search to its end: less is held back than in the steps of `follow`.
ROUND_DAMPING_SHARE = 0.03
# Loss of inliers at which a round is rejected, unless the kernel narrows by as much: a narrower one holds fewer.
MAX_INLIER_FRACTION_LOSS = 0.02


def deskew(points: Any, times: Any, motion: Any) -> FloatArray:
    """Undo the motion of the sensor during a sweep: every point as it would be seen at the end of the sweep.

    Parameters
    ----------
    points : (n, 3) array_like
        Points, each in the sensor's frame at its own time; rows that are not finite stay so.
    times : (n,) array_like
        Time of each point. The sweep ends at the latest. Any unit and offset with a pose as motion; with a trajectory
        its own clock.
    motion : (4, 4) array_like, or Trajectory
        Pose T_start_end of the sensor at the end of the sweep in its frame at the start: the motion is along one screw
        at constant velocity. Or the sensor's trajectory, T_world_sensor, over all of the times.

    Returns
    -------
    ndarray, (n, 3)
        Points in the sensor's frame at the end of the sweep, in the order given.

    Raises
    ------
    InputError
        If the shapes are wrong, a time is not finite or lies outside of the trajectory, or the motion is not rigid.

    Notes
    -----
    `Odometry` does it by itself for frames with times; there, points out of range are left out too.

    Examples
    --------
    A sensor that drives by 1 along x looks at one place from start, middle and end:

    >>> from dqreg.rigid import pose
    >>> T_start_end = pose.from_parts(np.eye(3), [1.0, 0.0, 0.0])
    >>> deskew([[5.0, 0, 0], [4.5, 0, 0], [4.0, 0, 0]], [0.0, 0.5, 1.0], T_start_end).tolist()
    [[4.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    """
    rows, stamps = as_float(points, "points"), as_float(times, "times")
    if rows.ndim != 2 or rows.shape[1] != 3 or stamps.shape != (len(rows),):
        raise InputError(
            f"points must be (n, 3) and times (n,), one a point; got shapes {rows.shape} and {stamps.shape}"
        )
    require_finite(stamps, "times")
    if not isinstance(motion, Trajectory):
        motion = as_pose(motion, "motion")
    if not len(rows):
        return rows.copy()
    end, span = float(stamps.max()), float(np.ptp(stamps))
    if isinstance(motion, Trajectory):
        moved = pose.inverse(motion.at(end)) @ motion.at(stamps)
    else:
        # Points of one time are those of its end.
        back = (stamps - end) / span if span > 0.0 else np.zeros(len(rows))
        return swept(rows, back, motion)
    return np.asarray(np.einsum("nij,nj->ni", moved[:, :3, :3], rows) + moved[:, :3, 3])


@dataclasses.dataclass(frozen=True)
class Deskewed:
    """A frame without the motion during its sweep, and where it was placed."""

    frame: DownsampledFrame  # The frame without the motion
    aligned: Alignment  # Where it was placed
    notes: tuple[Reason, ...] = ()

    @staticmethod
    def at_once(frame: DownsampledFrame, search: FrameSearch, worthwhile: float, *, near: bool) -> Deskewed | None:
        """A frame near its prediction, pose and motion found at once; None where that does not fit as usual."""
        if frame.back is None or search.settings.method != "plane" or len(frame.seen) < MIN_POINTS_FOR_CELLS:
            return None
        sweep = SweptFrame(frame, worthwhile)
        aligned = search.find_with_sweep(sweep, near=near)
        fits = aligned.status == "converged" and search.fits(aligned) and is_in_cells(aligned)
        return Deskewed(sweep.frame, aligned) if fits else None

    def repeated(self, search: FrameSearch, worthwhile: float) -> Deskewed:
        """The same with the motion that makes the sweep fit best, until it stays within a length."""
        best = self
        if not search.fits(best.aligned):
            # The motion that was removed may have been far off, or the times are no times.
            plain = best.frame.without(np.eye(4))
            aligned = search.find(plain, trust_motion=False)
            if aligned.inlier_fraction > best.aligned.inlier_fraction:
                words = "the sweep was not deskewed: the frame fits better as it is than with its times"
                best = Deskewed(plain, aligned, (Reason(words, "not_deskewed"),))
        if best.aligned.found and is_in_cells(best.aligned):
            sweep = SweptFrame(best.frame, worthwhile)
            aligned = search.settle_sweep(sweep, best.aligned)
            if fits_no_worse(aligned, best.aligned):
                return Deskewed(sweep.frame, aligned, best.notes)
            # What was found of fewer points is settled with all.
            T, scan = best.aligned.T_target_source, search.scan_of(best.frame)
            return dataclasses.replace(best, aligned=search.settle(scan, T, best.aligned))
        for _ in range(MAX_ROUNDS):
            if not best.aligned.found:
                break
            step, change = sweep_steps(best.frame, best.aligned)
            if off_at(best.frame.reach, change) <= worthwhile:
                break
            frame = best.frame.without(orthonormal(twist.exp(twist.log(best.frame.motion) + change)))
            T = orthonormal(best.aligned.T_target_source @ twist.exp(step))
            aligned = search.settle(search.scan_of(frame), T, best.aligned)
            if not fits_no_worse(aligned, best.aligned):
                break
            best = Deskewed(frame, aligned)
        return best


def fits_no_worse(after: Alignment, before: Alignment) -> bool:
    """Whether a frame fits as well as before: as many inliers, or as many for the width of their kernel."""
    share = after.inlier_fraction / before.inlier_fraction if before.inlier_fraction > 0.0 else np.inf
    return bool(
        after.inlier_fraction >= before.inlier_fraction - MAX_INLIER_FRACTION_LOSS
        or share * before.mixture.scale >= after.mixture.scale
    )


def sweep_steps(frame: DownsampledFrame, aligned: Alignment) -> tuple[FloatArray, FloatArray]:
    """Twists, (6,) each, in the sensor's frame: of the pose at the end of the sweep, and of the motion during it.

    With heights h over the planes and rows ``a = [x x n, n]`` a point of time ``s``, -1 to 0, comes to lie on its plane
    where ``h + a (step + s change) = 0``. What the times hardly tell, as along a corridor, is left as it was.
    """
    pairs, s = aligned.pairs, frame.back
    assert s is not None
    normals = pairs.closest.normals @ pairs.T_target_source[:3, :3]
    points, weights = pairs.scan.points, np.where(normals.any(axis=1), aligned.weights, 0.0)
    lever = float(np.sqrt(weights @ np.einsum("ij,ij->i", points, points) / weights.sum()))
    rows = np.hstack([np.cross(points / lever, normals), normals])
    first, second = rows * weights[:, None], rows * (weights * s)[:, None]
    ends, both, sweeps = product(first.T, rows), product(second.T, rows), product(second.T, rows * s[:, None])
    damping = ROUND_DAMPING_SHARE * (weights @ (s - weights @ s / weights.sum()) ** 2) * np.eye(6)
    full = np.block([[ends + damping, both], [both, sweeps + damping]])
    found = np.linalg.solve(full, -np.concatenate([first.T @ pairs.point_to_plane, second.T @ pairs.point_to_plane]))
    scale = scaling_by(1.0 / lever)
    return scale * found[:6], scale * found[6:]


@dataclasses.dataclass(frozen=True)
class FirstSweep:
    """What the second frame tells of the first one."""

    motion: FloatArray  # (4, 4): During the second sweep
    fits: bool  # Whether it is what both frames have in common: times may be no times
    map: VoxelMap | None = None  # Of the first frame without its own motion; None where that changes nothing, or worse


def undo_first_sweep(
    search: FrameSearch, first: DownsampledFrame, frame: DownsampledFrame, ratio: float
) -> FirstSweep | None:
    """Make the map anew of the first frame without the motion during its sweep; None where that was not found.

    How the second frame is skewed against it is how its motion differs; half of that more and less than the way
    between the middles of their sweeps is what both motions are.
    """
    lengths, T_first = search.lengths, search.anchors[0][0]
    # A map of one sweep has planes for few of its points: they are made beside.
    _ = Later(lambda: frame.own.fits)
    aligned = search.find(frame, trust_motion=False)
    skewed = Deskewed(frame, aligned).repeated(search, REPEATED_MISFIT_VOXELS * lengths.voxel_size)
    if not skewed.aligned.inlier_fraction >= LOST_FRACTION:
        return None
    half = 0.5 * twist.log(skewed.frame.motion)
    middle = orthonormal(pose.inverse(T_first) @ skewed.aligned.T_target_source @ twist.exp(-half))
    mean = twist.log(middle) / max(ratio, 1.0)
    motion = twist.exp(mean + half)
    if off_at(frame.reach, mean - half) <= REPEATED_MISFIT_VOXELS * lengths.voxel_size:
        return FirstSweep(motion, fits=True)
    made = VoxelMap(lengths)
    made.insert(lambda: first.without(twist.exp(mean - half)).dense, T_first)
    there = dataclasses.replace(search, surface=made.surface)
    # As few as it is compared with were placed by.
    scan = search.scan_of(frame.without(motion)).thinned(POINTS_BEFORE_SWEEP)
    T = predict(T_first, motion, ratio)
    straight = there.settle(scan, T, aligned, anew=True)
    if not fits_no_worse(straight, aligned):
        straight = there.refine(scan, T)
    fits = fits_no_worse(straight, aligned)
    return FirstSweep(motion, fits, made if fits else None)
