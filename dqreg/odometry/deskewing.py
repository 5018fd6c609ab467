"""Deskewing: the motion during a sweep is removed with the last motion first, then with the one that was found.

KISS-ICP takes the last frame's motion. Where the sensor has just changed its motion, that distorts the frame; the pose
found with it is a better estimate, so the frame is deskewed once more and placed again from there.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_pose, require_finite
from dqreg.errors import InputError
from dqreg.icp import Alignment
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import DownsampledFrame, RawFrame, downsample_frame
from dqreg.odometry.kiss import KissParts, rigid
from dqreg.odometry.starts import predict
from dqreg.rigid import Trajectory, pose, twist
from dqreg.trust.records import Reason

# The frame is deskewed again while the motion is wrong by this fraction of a voxel at the frame's edge, and so many
# times at most; each round halves the error, about.
WORTHWHILE, ROUNDS = 0.1, 5
# Loss of inliers at which a round is rejected: kernel scales estimated anew change the fraction by less.
WORSE = 0.02


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
        moved = twist.exp(back[:, None] * twist.log(motion))
    return np.asarray(np.einsum("nij,nj->ni", moved[:, :3, :3], rows) + moved[:, :3, 3])


@dataclasses.dataclass(frozen=True)
class Deskewed:
    """A frame without the motion during its sweep, and where it was placed."""

    kiss: KissParts  # Removes motions
    raw: RawFrame  # The frame, with times
    voxel_size: float  # Edge of a voxel of the map
    frame: DownsampledFrame  # The frame without the motion
    aligned: Alignment  # Where it was placed
    motion: FloatArray  # (4, 4): The motion that was undone
    notes: tuple[Reason, ...] = ()

    def repeated(self, search: FrameSearch, T_last: FloatArray, ratio: float) -> Deskewed:
        """The same with the motion that was found, until both agree."""
        best = self
        if not search.fits(best.aligned):
            # The motion that was removed may have been far off, or the times are no times.
            plain = self._again(np.eye(4), None, search)
            if plain is not None and plain.aligned.inlier_fraction > best.aligned.inlier_fraction:
                words = "the sweep was not deskewed: the frame fits better as it is than with its times"
                best = dataclasses.replace(plain, notes=(Reason(words, "not_deskewed"),))
        for _ in range(ROUNDS):
            if not best.aligned.found:
                break
            T = best.aligned.T_target_source
            motion = rigid(predict(np.eye(4), rigid(pose.inverse(T_last) @ T), 1.0 / max(ratio, 1.0)))
            change = pose.inverse(best.motion) @ motion
            off = best.frame.reach * float(pose.angle_between(np.eye(4), change)) + float(np.linalg.norm(change[:3, 3]))
            if off <= WORTHWHILE * self.voxel_size:
                break
            again = best._again(motion, T, search)
            if again is None or again.aligned.inlier_fraction < best.aligned.inlier_fraction - WORSE:
                break
            best = again
        return best

    def _again(self, motion: FloatArray, T: FloatArray | None, search: FrameSearch) -> Deskewed | None:
        """With another motion: placed near T, or searched anew."""
        frame = downsample_frame(self.kiss.compensate(self.raw.points, self.raw.times, motion), self.voxel_size)
        if frame is None:
            return None
        aligned = search.find(frame.scan, trust_motion=False) if T is None else search.refine(frame.scan, T)
        return dataclasses.replace(self, frame=frame, aligned=aligned, motion=motion, notes=())
