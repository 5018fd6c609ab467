"""One run as a record of plain values; the field names are the keys of the JSON lines."""

from __future__ import annotations

import dataclasses
from typing import Any

from dqreg.registration.batch.worker import Status


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """One run of one engine on one task, judged."""

    key: str  # Names the task: runs of one key did the same
    engine: str  # Name of the engine
    repeat: int  # 0 for the first timed run
    # case, axis, value, trial, setting: The task: name, axis of the sweep ("case" for none), value on it, draw, setting
    case: str
    axis: str
    value: str | float | None
    trial: int
    setting: str
    without_initial_pose: bool  # Whether the task had no initial pose
    points: int  # Scan points that the engine was given
    size: float  # S, target units
    units: str  # Length unit, "" if unknown
    # "ran": a pose or NaN came back. Else no pose: an exception, a dead process, no answer in time, too much memory
    status: Status
    message: str  # What went wrong; "" if nothing
    T_target_source: list[list[float]] | None  # As returned; None where there is none
    seconds: float  # From raw data to pose
    prepare_seconds: float  # The part of it that a second scan would not need again; NaN if unknown
    wall_seconds: float  # Measured from outside around the whole call, in which an engine may also record its curve
    peak_memory: float  # Bytes that the process grew by at its highest; NaN if unknown
    iterations: int | None  # Where the engine reports it
    self_report: str  # What it says of its answer
    settings: dict[str, Any]  # Parameters that it ran with
    # kind, success, angle_rad, offset, worst, rms, surface_rms, overlap: As in `dqreg.compare.judge.Score`
    kind: str
    success: bool | None
    angle_rad: float
    offset: float
    worst: float
    rms: float
    surface_rms: float
    overlap: float
    # Iteration, seconds and worst displacement, where the engine reports intermediate poses
    curve: list[tuple[int, float, float]]
    identity: str = ""  # Tells the code that made it from all other; "" in files of version 0.1
