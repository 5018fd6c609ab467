"""A sequence through the odometry: each frame registered while the next one is read and prepared."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.threads import Later
from dqreg.odometry.frame import RawFrame, read_frame
from dqreg.odometry.motion import MotionGuide, MotionPrior
from dqreg.odometry.odometry import Odometry
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.scans import FrameData, Scans
from dqreg.odometry.settings import OdometrySettings
from dqreg.registration.result.result import Registration
from dqreg.trust.records import Reason, Verdict


@dataclasses.dataclass(frozen=True)
class TrajectoryRun:
    """A sequence after it was run."""

    name: str  # What ran it
    poses: FloatArray  # (n, 4, 4): NaN where none was found
    results: tuple[Registration, ...]  # One a frame, for our engine; empty for others, which have no verdicts
    seconds: FloatArray  # (n,): Wall time of each frame, without reading it


def run_sequence(
    scans: Scans,
    settings: OdometrySettings,
    tell: Callable[[int, Registration], object] | None = None,
    show: Callable[[FloatArray, Registration], object] | None = None,
    motion: MotionPrior | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> TrajectoryRun:
    """Run our odometry over a sequence, or until ``stop`` says so; a frame that cannot be read fails alone."""
    odometry, guide = Odometry(settings), None if motion is None else MotionGuide(motion)
    frames, results = _Frames(odometry, scans), list[Registration]()
    for number in range(len(scans)):
        if stop():
            break
        data = frames.read(number)
        began = time.perf_counter()
        raw = frames.prepared(data)
        stamp = None if scans.times is None else float(scans.times[number])
        given = {} if guide is None else guide.options(stamp)
        expected = Prediction.of(given.get("prediction"), given.get("prediction_covariance"))
        result = _explained(odometry._registered(raw, stamp, expected, began), data)
        results.append(result)
        if guide is not None:
            # Of a frame whose stamp is wrong the place is known, and not when.
            guide.learn(result, odometry.last_pose, None if "time_stamp" in result.verdict.codes else stamp)
        if show is not None:
            show(data.points, result)
        if tell is not None:
            tell(number, result)
    return TrajectoryRun("dqreg", odometry.poses, tuple(results), np.array([r.timings["total"] for r in results]))


class _Frames:
    """Frames of a sequence, each prepared beside the one before it, as far as that decides nothing of it."""

    def __init__(self, odometry: Odometry, scans: Scans) -> None:
        self._odometry, self._scans = odometry, scans
        self._following: FrameData | None = None
        self._coming: Later[RawFrame] | None = None

    def read(self, number: int) -> FrameData:
        """A frame and, for later, the next one: on the caller's thread, as files of some bags want to be read."""
        scans = self._scans
        data = scans[number] if self._following is None else self._following
        self._following = scans[number + 1] if number + 1 < len(scans) else None
        return data

    def prepared(self, data: FrameData) -> RawFrame:
        """The frame that was read, as it is registered; the next one is begun."""
        raw = _checked(data) if self._coming is None else self._coming.result()
        following = self._following
        begun = None if following is None else Later(lambda: self._odometry._ahead(_checked(following)))
        self._coming = begun
        return raw


def _checked(data: FrameData) -> RawFrame:
    # In a file of a sequence times that do not match are a damaged frame, not a mistake of the caller.
    return read_frame(data.points, None if _mismatch(data) else data.timestamps)


def _mismatch(data: FrameData) -> tuple[Reason, ...]:
    if data.timestamps is None or len(data.timestamps) == len(data.points):
        return ()
    words = f"{len(data.timestamps)} times for {len(data.points)} points: not used"
    return (Reason(words, "not_deskewed"),)


def _explained(result: Registration, data: FrameData) -> Registration:
    """The result with what was wrong with the file."""
    mismatch, problem = _mismatch(data), (Reason(data.problem, "unreadable"),) if data.problem else ()
    reasons = (*problem, *mismatch, *result.verdict.reasons) if problem else (*result.verdict.reasons, *mismatch)
    return dataclasses.replace(result, verdict=Verdict(result.verdict.level, reasons))
