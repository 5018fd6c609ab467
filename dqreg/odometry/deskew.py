"""Motion during a sweep: undone with the last motion first, and again with the one that was found.

KISS-ICP undoes the last frame's motion. Where the sensor has just changed its mind, that bends the frame; the pose
found with it tells the motion better, so the frame is straightened once more and placed again from there.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.odometry.align import Aligned, Seeker
from dqreg.odometry.frame import Keypoints, RawFrame, thin_frame
from dqreg.odometry.kiss import KissParts, rigid
from dqreg.odometry.starts import predict
from dqreg.odometry.verdicts import fits
from dqreg.rigid import pose
from dqreg.trust.records import Reason

# The frame is straightened again while the motion that was undone is wrong by this share of a voxel at the frame's
# edge, and so many times at most; each round leaves about half of what was wrong.
WORTHWHILE, ROUNDS = 0.1, 5
# Loss of points on the map at which a round is taken back: widths learned anew change the share by less.
WORSE = 0.02


@dataclasses.dataclass(frozen=True)
class Undone:
    """A frame with a motion undone, and where it was placed."""

    kiss: KissParts  # Undoes motions
    frame: RawFrame  # The frame, with times
    voxel_size: float  # Edge of a voxel of the map
    keys: Keypoints  # The frame with the motion undone
    aligned: Aligned  # Where it was placed
    motion: FloatArray  # (4, 4): The motion that was undone
    notes: tuple[Reason, ...] = ()  # What is to be told

    def repeated(self, seek: Seeker, T_last: FloatArray, ratio: float) -> Undone:
        """The same with the motion that was found, until both agree."""
        best = self
        if not fits(best.aligned.on_map, seek.usual):
            # The motion that was undone may have been far off, or the times are no times.
            plain = self._again(np.eye(4), None, seek)
            if plain is not None and plain.aligned.on_map > best.aligned.on_map:
                words = "the sweep was not deskewed: the frame fits better as it is than with its times"
                best = dataclasses.replace(plain, notes=(Reason(words, "not_deskewed"),))
        for _ in range(ROUNDS):
            if not best.aligned.found:
                break
            T = best.aligned.run.T_target_source
            motion = rigid(predict(np.eye(4), rigid(pose.inverse(T_last) @ T), 1.0 / max(ratio, 1.0)))
            change = pose.inverse(best.motion) @ motion
            off = best.keys.reach * float(pose.angle_between(np.eye(4), change)) + float(np.linalg.norm(change[:3, 3]))
            if off <= WORTHWHILE * self.voxel_size:
                break
            again = best._again(motion, T, seek)
            if again is None or again.aligned.on_map < best.aligned.on_map - WORSE:
                break
            best = again
        return best

    def _again(self, motion: FloatArray, T: FloatArray | None, seek: Seeker) -> Undone | None:
        """With another motion undone: placed near T, or sought anew."""
        keys = thin_frame(self.kiss.compensate(self.frame.points, self.frame.times, motion), self.voxel_size)
        if keys is None:
            return None
        aligned = seek.find(keys.scan, trust_motion=False) if T is None else seek.refine(keys.scan, T)
        return dataclasses.replace(self, keys=keys, aligned=aligned, motion=motion, notes=())
