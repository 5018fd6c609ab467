"""One run as a record: what is kept of it, as plain numbers."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

from dqreg.errors import InputError

Status = Literal["ran", "error", "crashed", "timeout", "memory"]


@dataclasses.dataclass(frozen=True)
class Run:
    """One run of one engine on one task, judged."""

    key: str  # The task: runs of the same key did the same
    engine: str  # Name of the engine
    repeat: int  # 0 for the first timed run
    # case, axis, value, trial, setting: Place of the task: name, axis of the sweep ("case" for none), value on it,
    # draw, fair setting
    case: str
    axis: str
    value: str | float | None
    trial: int
    setting: str
    from_nothing: bool  # Whether the task had no start
    points: int  # Scan points that the engine was given
    size: float  # S, target units
    units: str  # Length unit, "" if unknown
    # "ran": a pose or NaN came back. Else no pose: an exception, a dead process, no answer in time, too much memory
    status: Status
    message: str  # What went wrong; "" if nothing
    T_target_source: list[list[float]] | None  # As handed in; None where there is none
    seconds: float  # From raw data to pose
    prepare_seconds: float  # The part of it that a second scan would not need again; NaN if unknown
    wall_seconds: float  # Measured from outside around the whole call, in which an engine may also record its curve
    peak_memory: float  # Bytes that the process grew by at its highest; NaN if unknown
    iterations: int | None  # Where the engine tells
    claims: str  # What it says about its own success
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
    # Iteration, seconds and worst displacement, where the engine reveals poses on the way
    curve: list[tuple[int, float, float]]


_FLOATS = [field.name for field in dataclasses.fields(Run) if field.type == "float"]


def to_plain(run: Run) -> dict[str, Any]:
    """Record as strict JSON takes it: NaN and infinity become None."""
    plain: dict[str, Any] = plain_values(dataclasses.asdict(run))
    return plain


def from_plain(values: Any) -> Run:
    """Record of what `to_plain` made."""
    try:
        found = {**values, **{name: math.nan for name in _FLOATS if values[name] is None}}
        found["curve"] = [(i, _nan(seconds), _nan(worst)) for i, seconds, worst in values["curve"]]
        return Run(**found)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"not the record of a run: {type(error).__name__} {error}") from error


def plain_values(value: Any) -> Any:
    """Plain JSON values of anything that a record or an engine's settings may hold.

    >>> plain_values({"a": (1.0, float("nan")), 2: None})
    {'a': [1.0, None], '2': None}
    """
    if hasattr(value, "tolist"):
        return plain_values(value.tolist())
    if isinstance(value, dict):
        return {str(key): plain_values(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [plain_values(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    return str(value)


def _nan(value: float | None) -> float:
    return math.nan if value is None else float(value)
