"""What a result looks like in JSON: fields to plain values and, not trusting anybody, back."""

from __future__ import annotations

import dataclasses
from typing import Any, get_args

import numpy as np

from dqreg._arrays import FloatArray, as_pose, require_finite
from dqreg.icp.history import Iteration
from dqreg.trust.records import Alternative, Direction, Level, Verdict


def read_fields(values: dict[str, Any]) -> dict[str, Any]:
    """Fields of a `Registration` from what `plain` made of one, each looked at."""
    return {
        "T_target_source": _pose(values["T_target_source"]),
        "verdict": Verdict(
            _level(values["verdict"]["level"]), tuple(map(_text, _of(list, values["verdict"]["reasons"])))
        ),
        "status": _text(values["status"]),
        "covariance": _array(values["covariance"], (6, 6)),
        "observability": tuple(
            Direction(_number(d["strength"]), _number(d["sigma"]), _text(d["words"])) for d in values["observability"]
        ),
        "alternatives": tuple(
            Alternative(_pose(a["T_target_source"]), _number(a["score"]), _text(a["symmetry"]))
            for a in values["alternatives"]
        ),
        "history": tuple(_iteration(record) for record in values["history"]),
        "rms": _number(values["rms"]),
        "inlier_fraction": _number(values["inlier_fraction"]),
        "timings": {key: _number(seconds) for key, seconds in _of(dict, values["timings"]).items()},
        "settings": _settings(_of(dict, values["settings"])),
    }


def _settings(values: dict[str, Any]) -> dict[str, Any]:
    # Only what methods of a result work with: the others are told, not used.
    for name in ("source_scale", "scale", "max_distance", "diagonal"):
        if name in values and not 0.0 < _of((int, float), values[name]) < np.inf:
            raise ValueError(f"{name} of {values[name]!r:.60}")
    for name in ("source_units", "target_units", "source", "target"):
        if name in values:
            _of((str, type(None)), values[name])
    if "seed" in values and _of(int, values["seed"]) < 0:
        raise ValueError(f"seed of {values['seed']!r:.60}")
    if values.get("scale_sigma") is not None and not 0.0 <= _of((int, float), values["scale_sigma"]) < np.inf:
        raise ValueError(f"scale_sigma of {values['scale_sigma']!r:.60}")
    if values.get("viewpoint") is not None:
        places = np.array(values["viewpoint"], dtype=np.float64)
        require_finite(_array(values["viewpoint"], (len(places), 3)), "viewpoint")
    if "centre" in values:
        require_finite(_array(values["centre"], (3,)), "centre")
    return values


def _iteration(record: dict[str, Any]) -> Iteration:
    fields: dict[str, Any] = {
        key: _text(value) if key == "stage" else _of((int, float, type(None)), value)
        for key, value in _of(dict, record).items()
        if key not in ("T_target_source", "scale")
    }
    if "kernel_scale" not in fields:
        # A result of old.
        fields["kernel_scale"] = _of((int, float, type(None)), record["scale"])
    fields["T_target_source"] = _pose(record["T_target_source"])
    # A motion is infinite where an extrapolation was taken back; anything else that is not finite was NaN.
    missing = {key: np.inf if key == "motion" else np.nan for key, value in fields.items() if value is None}
    return Iteration(**{**fields, **missing})


def plain_iteration(record: Iteration) -> dict[str, Any]:
    """Plain values of an iteration; readers of old look for the kernel scale under ``scale``."""
    return {**plain(record), "scale": plain(record.kernel_scale)}


def _of(kind: type | tuple[type, ...], value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"cannot use {value!r:.60}")
    return value


def _text(value: Any) -> str:
    text: str = _of(str, value)
    return text


def _level(value: Any) -> Level:
    if value not in get_args(Level):
        raise ValueError(f"unknown level {value!r:.60}; known are {', '.join(get_args(Level))}")
    level: Level = value
    return level


def _pose(rows: Any) -> FloatArray:
    T = _array(rows, (4, 4))
    if not np.isnan(T).all():
        # Looked at, but kept as it was: to the last bit.
        as_pose(T, "T_target_source")
    return T


def _array(rows: Any, shape: tuple[int, ...]) -> FloatArray:
    # None becomes NaN in a float array.
    array = np.array(rows, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"an array of shape {array.shape} instead of {shape}")
    return array


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def plain(value: Any) -> Any:
    """Lists, numbers and strings of anything in a result; NaN and infinity become None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
