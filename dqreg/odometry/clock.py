"""The clock that stamps frames: which stamp is a wrong one, and whether the clock was set anew.

One wrong stamp must not make the right ones after it look wrong: what does not follow is refused, and only a second
stamp that follows the refused one is taken for another clock.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.trust.records import Reason

# A step of so many times the longest of the last ones is a gap, or a wrong stamp; how many these are.
FAR_STEPS, REMEMBERED_STEPS = 100.0, 10


class Clock:
    """Times of the frames, of which some may be wrong."""

    def __init__(self) -> None:
        # Whether it may be very long since the last trusted frame: a stamp was far ahead.
        self.is_ahead = False
        # Of the frame of now and of the last trusted one; None where unknown.
        self._now: float | None = None
        self._trusted: float | None = None
        # The last stamp that was taken, the frames since, and those from it to a trusted one whose time is unknown.
        self._last: float | None = None
        self._frames, self._owed = 0, -1
        self._steps: deque[float] = deque(maxlen=REMEMBERED_STEPS)  # Seconds a frame
        # The last stamp that was refused, the frames up to it, and its step from another such one.
        self._other: float | None = None
        self._other_frames, self._other_step = 0, 0.0

    @property
    def gap(self) -> float:
        """Seconds since the last trusted frame, at least; 0 where unknown."""
        if self.is_ahead:
            return FAR_STEPS * max(self._steps, default=0.0)
        return 0.0 if self._now is None or self._trusted is None else self._now - self._trusted

    @property
    def last_trusted(self) -> tuple[float | None, int]:
        """Time of the last trusted frame where it is known, else the frames from the last stamp taken to it, or -1."""
        return self._trusted, self._owed

    @last_trusted.setter
    def last_trusted(self, value: tuple[float | None, int]) -> None:
        self._trusted, self._owed = value

    def trust(self) -> None:
        """The frame of now is trusted."""
        self._trusted, self.is_ahead = self._now, False
        self._owed = -1 if self._last is None else self._frames

    def resume(self, ago: int) -> None:
        """The frame is trusted that was so many before the frame of now."""
        self._trusted, self._owed = None, -1
        if self._now is not None and self._steps:
            self._trusted = self._now - ago * self._steps[-1]

    def read(self, stamp: float | None) -> Reason | None:
        """Take the stamp of the next frame; what is wrong with it, or that it is of another clock."""
        self._frames, self._now = self._frames + 1, None
        if stamp is None:
            return None
        if not np.isfinite(stamp):
            return Reason("the frame's time is not finite", "time_stamp")
        if self._last is None:
            self._last = self._now = self._trusted = stamp
            self._frames = 0
            return None
        longest = max(self._steps, default=np.inf)
        if 0.0 < stamp - self._last <= FAR_STEPS * longest * self._frames:
            self.is_ahead = False
            self._take(stamp, self._last, 0)
            return None
        further = 0.0 if self._other is None else stamp - self._other
        if self._other is None or not 0.0 < further <= FAR_STEPS * max(longest, self._other_step):
            self.is_ahead = stamp > self._last
            self._other, self._other_frames, self._other_step = stamp, self._frames, max(further, 0.0)
            return _wrong(stamp, self._last, longest)
        words = (
            f"the clock of the frames was set anew, or paused: {stamp:.6f} follows {self._other:.6f}, which did not "
            f"follow {self._last:.6f}"
        )
        self._steps.clear()
        self._take(stamp, self._other, self._other_frames)
        return Reason(words, "new_clock")

    def _take(self, stamp: float, before: float, passed: int) -> None:
        """Take a stamp after another, so many frames after the last one that was taken: those between come evenly."""
        a_frame = (stamp - before) / (self._frames - passed)
        self._steps.append(a_frame)
        if self._trusted is None:
            self._trusted = before + (self._owed - passed) * a_frame if self._owed >= passed else None
        elif before != self._last:
            # Of the clock before.
            self._trusted = None
        self.is_ahead = self.is_ahead and self._trusted is None
        self._last, self._now, self._frames, self._owed, self._other = stamp, stamp, 0, -1, None


def stamp_given(stamp: Any) -> float | None:
    """A caller's stamp, checked."""
    try:
        if isinstance(stamp, str | bytes):
            raise TypeError
        return None if stamp is None else float(stamp)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"stamp must be a number, the frame's time in seconds, or None; got {stamp!r}") from error


def _wrong(stamp: float, last: float, longest: float) -> Reason:
    if stamp <= last:
        return Reason(f"the frame's time {stamp:.6f} is not after that of the frame before, {last:.6f}", "time_stamp")
    words = (
        f"the frame's time {stamp:.6f} is {stamp - last:.6g} s after that of the frame before, and {longest:.3g} s was "
        "the longest step of late: frames are missing, or the time is wrong"
    )
    return Reason(words, "time_stamp")
