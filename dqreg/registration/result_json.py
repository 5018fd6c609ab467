"""What a result looks like in JSON: fields to plain values and, not trusting anybody, back."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose, require_finite
from dqreg.files.strict_json import plain, record_from
from dqreg.icp.history import Iteration
from dqreg.trust.records import Direction, Reason, Verdict


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


def _verdict(values: Any) -> Verdict:
    values = dict(_of(dict, values))
    sentences = _of(list, values["reasons"])
    # A result of old has no codes.
    codes = _of(list, values.pop("codes", [""] * len(sentences)))
    reasons = tuple(Reason(_of(str, words), _of(str, code)) for words, code in zip(sentences, codes, strict=True))
    return record_from(Verdict, values, {"reasons": lambda _: reasons})


def plain_verdict(verdict: Verdict) -> dict[str, Any]:
    """Plain values of a verdict, the codes of its reasons beside them."""
    return {**plain(verdict), "codes": list(verdict.codes)}


def _direction(values: Any) -> Direction:
    return record_from(Direction, {name: value for name, value in _of(dict, values).items() if name != "is_free"})


def plain_direction(direction: Direction) -> dict[str, Any]:
    """Plain values of a direction."""
    return {**plain(direction), "is_free": direction.is_free}


def _iteration(record: Any) -> Iteration:
    values = dict(_of(dict, record))
    # The only name of the kernel scale in a result of old.
    scale = values.pop("scale", None)
    return record_from(Iteration, {"kernel_scale": scale, **values}, CHECKS)


def plain_iteration(record: Iteration) -> dict[str, Any]:
    """Plain values of an iteration; readers of old look for the kernel scale under ``scale``."""
    return {**plain(record), "scale": plain(record.kernel_scale)}


def _of(kind: type | tuple[type, ...], value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"cannot use {value!r:.60}")
    return value


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


# Fields that plain types do not tell enough about.
CHECKS = {
    "T_target_source": _pose,
    "verdict": _verdict,
    "observability": lambda directions: tuple(_direction(direction) for direction in _of(list, directions)),
    "covariance": lambda rows: _array(rows, (6, 6)),
    "settings": lambda values: _settings(_of(dict, values)),
    "history": lambda records: tuple(_iteration(record) for record in _of(list, records)),
    # Infinite where an extrapolation was taken back.
    "motion": lambda value: np.inf if value is None else _of((int, float), value),
}
