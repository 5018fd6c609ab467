"""The frames so far: their poses and stamps, and the pace of the motion."""

from __future__ import annotations

import dataclasses
from collections import deque

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.odometry.clock import Clock
from dqreg.rigid import Trajectory
from dqreg.trust.records import Reason

# Steps of the last motion beyond which constant velocity is a guess like any other.
MAX_PREDICTED_STEPS = 5.0


@dataclasses.dataclass(frozen=True)
class LastTrusted:
    """The last trusted frame, as a timeline and its clock know it."""

    missed: int  # Frames since
    slid: int  # Those of them that only left a motion free
    pace: float  # Seconds a frame, 0 where unknown
    is_ahead: bool  # Whether it may be very long since
    by_clock: tuple[float | None, int]  # See `Clock.last_trusted`


class Timeline:
    """Poses and stamps of the last frames, and how long it is since the last trusted one."""

    def __init__(self, history: int | None) -> None:
        self.count = 0  # Frames so far
        self.missed = 0  # Frames since the last trusted one
        self.slid = 0  # Those of them that only left a motion free
        self._poses: deque[FloatArray] = deque(maxlen=history)
        self._stamps: deque[float | None] = deque(maxlen=history)
        self._clock = Clock()
        self._pace = 0.0  # Seconds a frame, where stamps told

    @property
    def has_slid(self) -> bool:
        """Whether frames came since the last trusted one, and all of them only left a motion free."""
        return 0 < self.slid == self.missed

    @property
    def steps(self) -> float:
        """Frames since the last trusted one, with the one to come."""
        return 1.0 + self.missed

    @property
    def _gap(self) -> float:
        """Seconds since the last trusted frame; 0 where unknown."""
        return self._clock.gap

    @property
    def is_ahead(self) -> bool:
        """Whether it may be very long since the last trusted frame, or the stamps are wrong."""
        return self._clock.is_ahead

    @property
    def is_guessed(self) -> bool:
        """Whether constant velocity is a guess like any other: the stamps tell of a gap."""
        return self.span > max(MAX_PREDICTED_STEPS, self.steps)

    @property
    def span(self) -> float:
        """The same by the stamps, where they tell."""
        return max(self._gap / self._pace, self.steps) if self._gap > 0.0 and self._pace > 0.0 else self.steps

    @property
    def is_timed(self) -> bool:
        """Whether the time since the last trusted frame is known, and constant velocity tells what came in it.

        A frame that slid may have hidden that it did not.
        """
        return self._gap > 0.0 and self.span <= MAX_PREDICTED_STEPS and not self.slid

    @property
    def poses(self) -> FloatArray:
        """Poses of the frames that are kept, (n, 4, 4)."""
        return np.array(self._poses).reshape(-1, 4, 4)

    @property
    def trajectory(self) -> Trajectory:
        """The frames that were placed, at their stamps; at their numbers where one has none or goes back."""
        found = np.flatnonzero(np.isfinite(self.poses).all(axis=(1, 2)))
        if not len(found):
            raise InputError(f"none of the {len(self._poses)} frames was placed; there is no trajectory")
        stamps = np.array([np.nan if stamp is None else stamp for stamp in self._stamps])[found]
        timed = bool(np.isfinite(stamps).all() and np.all(np.diff(stamps) > 0.0))
        numbers = found.astype(np.float64) + (self.count - len(self._poses))
        return Trajectory(stamps if timed else numbers, self.poses[found])

    def add(self, T: FloatArray, stamp: float | None) -> None:
        """Keep the pose of a frame."""
        self.count += 1
        self._poses.append(T)
        self._stamps.append(stamp)

    def ratio(self, stamp: float | None) -> tuple[float, Reason | None]:
        """Time since the last trusted frame over that of the last motion, and what is to be said of the stamp."""
        remark = self._clock.read(stamp)
        if self._clock.is_ahead or not self._gap > 0.0 or not self._pace > 0.0:
            return self.steps, remark
        return float(np.clip(self._gap / self._pace, 0.0, MAX_PREDICTED_STEPS)), remark

    def last_trusted(self) -> LastTrusted:
        """What the next frames are measured from, to be put back where a try is in vain."""
        clock = self._clock
        return LastTrusted(self.missed, self.slid, self._pace, clock.is_ahead, clock.last_trusted)

    def put_back(self, last: LastTrusted) -> None:
        """Measure from there again; stamps that were read since stay read."""
        self.missed, self.slid, self._pace = last.missed, last.slid, last.pace
        self._clock.is_ahead, self._clock.last_trusted = last.is_ahead, last.by_clock

    def resume(self, missed: int) -> None:
        """Trust an earlier frame after all, so many before the frame of now."""
        self.missed, self.slid = missed, 0
        self._clock.resume(missed + 1)

    def find_again(self) -> None:
        """The frame of now was found by other means: the time since the last trusted one tells no pace."""
        self._clock.trust()
        self.missed, self.slid = 0, 0

    def trust(self) -> None:
        """The frame of now is trusted: the pace is that of the steps since the last one, where it is known."""
        if not self._clock.is_ahead and self._gap > 0.0:
            self._pace = self._gap / self.steps
        self.find_again()
