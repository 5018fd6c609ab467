"""A result as JSON: fields to plain values and back, every value of a file checked."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import RIGID_TOLERANCE, FloatArray, as_pose, require_finite
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.files.length_names import DISTANCES, SIZES
from dqreg.files.strict_json import fields_from, plain, record_from
from dqreg.icp.history import Iteration
from dqreg.registration.result.invariants import violated_invariant
from dqreg.trust.records import Direction, Reason, Verdict

FORMAT = "dqreg registration 1"
ANGLE_UNITS = "rad"
# What who opens the file in another program cannot guess.
CONVENTIONS = {
    "T_target_source": "p_target = T_target_source (scale p_source, 1); row by row",
    "dual_quaternion": "real and dual, each w, x, y, z; of unit length",
    "covariance": "rotation vector x, y, z, then translation x, y, z: of a left increment in the target frame about "
    "settings.centre",
}


def to_plain(result: Any) -> dict[str, Any]:
    """Plain values of a `Registration` under its attribute names."""
    values = {name: plain(getattr(result, name)) for name in _names(type(result))}
    found = bool(np.isfinite(result.T_target_source).all())
    dq = result.dual_quaternion if found else None
    values["dual_quaternion"] = {"real": plain(dq.real), "dual": plain(dq.dual)} if dq else None
    # The codes of the reasons beside them; readers of old look for the kernel scale of an iteration under ``scale``.
    values["verdict"] = {**plain(result.verdict), "codes": list(result.verdict.codes)}
    values["observability"] = [{**plain(each), "is_free": each.is_free} for each in result.observability]
    values["history"] = [{**plain(record), "scale": plain(record.kernel_scale)} for record in result.history]
    values |= {"scale": result.scale, "scale_sigma": plain(result.scale_sigma)}
    told = {"units": result.settings.get("target_units"), "angle_units": ANGLE_UNITS, "conventions": CONVENTIONS}
    return {"format": FORMAT, **told, **values}


def as_text(result: Any) -> str:
    """The file of a `Registration`."""
    return text_of(to_plain(result))


def text_of(values: dict[str, Any]) -> str:
    """The file of a result's plain values."""
    return json.dumps(values, indent=1, allow_nan=False) + "\n"


def read_fields(path: str | Path, cls: type) -> dict[str, Any]:
    """Fields of a `Registration`, which is the class, from a file."""
    wanted = "dqreg register --out result.json or Registration.save"
    return read_saved(path, FORMAT, "dqreg result", wanted, lambda values: registration_fields(values, cls))


def read_saved(
    path: str | Path, form: str, kind: str, writer: str, fields_of: Callable[[dict[str, Any]], dict[str, Any]]
) -> dict[str, Any]:
    """Fields of a result of one format from a file, each checked; whatever else lies there is an `InputError`."""
    values = read_json(path, f"the JSON that {writer} wrote, not a pose alone", kind=kind)
    if values.get("format") != form:
        raise InputError(f'{path} is no {kind}: expected the key "format" to be {form!r}')
    try:
        return fields_of(values)
    except (KeyError, TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{path} is a damaged {kind}: {type(error).__name__} {error}") from error


def registration_fields(values: dict[str, Any], cls: type) -> dict[str, Any]:
    """Fields of a `Registration`, which is the class, of what `to_plain` made of one, today or in a version of old."""
    # Files of old do not have it.
    known = {"partial_information": None, **values}
    fields = fields_from(cls, {name: known[name] for name in _names(cls)}, CHECKS)
    if violated := violated_invariant(fields):
        # What this package saved keeps them: the file was written or changed elsewhere.
        raise ValueError(violated)
    return fields


def _names(cls: type) -> list[str]:
    return [field.name for field in dataclasses.fields(cls) if field.name != "inputs"]


def _settings(values: dict[str, Any]) -> dict[str, Any]:
    # Only what methods of a result compute with.
    for name in ("source_scale", "scale", *SIZES):
        if name in values and not 0.0 < _of((int, float), values[name]) < np.inf:
            raise ValueError(f"{name} of {values[name]!r:.60}")
    for name in ("source_units", "target_units", "source", "target"):
        if name in values:
            _of((str, type(None)), values[name])
    for name in DISTANCES:
        if values.get(name) is not None and not 0.0 <= _of((int, float), values[name]) < np.inf:
            raise ValueError(f"{name} of {values[name]!r:.60}")
    for name in ("source_points", "used_points", "source_dropped"):
        if name in values and _of(int, values[name]) < 0:
            raise ValueError(f"{name} of {values[name]!r:.60}")
    if "seed" in values and _of(int, values["seed"]) < 0:
        raise ValueError(f"seed of {values['seed']!r:.60}")
    if values.get("scale_sigma") is not None and not 0.0 <= _of((int, float), values["scale_sigma"]) < np.inf:
        raise ValueError(f"scale_sigma of {values['scale_sigma']!r:.60}")
    if values.get("viewpoint") is not None:
        places = np.array(values["viewpoint"], dtype=np.float64)
        require_finite(float_array(values["viewpoint"], (len(places), 3)), "viewpoint")
    for name in ("centre", "source_viewpoint"):
        if name in values:
            require_finite(float_array(values[name], (3,)), name)
    return values


def read_verdict(values: Any) -> Verdict:
    """A verdict of what `to_plain` made of one."""
    values = dict(_of(dict, values))
    sentences = _of(list, values["reasons"])
    # A result of old has no codes.
    codes = _of(list, values.pop("codes", [""] * len(sentences)))
    reasons = tuple(Reason(_of(str, words), _of(str, code)) for words, code in zip(sentences, codes, strict=True))
    confidence = values.get("confidence")
    if confidence is not None and not 0.0 <= _of((int, float), confidence) <= 1.0:
        raise ValueError(f"confidence of {confidence!r:.60}")
    # A check's code that this version does not know is kept as it is.
    return record_from(Verdict, values, {"reasons": lambda _: reasons, "code": lambda code: _of(str, code)})


def _direction(values: Any) -> Direction:
    return record_from(Direction, {name: value for name, value in _of(dict, values).items() if name != "is_free"})


def _iteration(record: Any) -> Iteration:
    values = dict(_of(dict, record))
    # The only name of the kernel scale in a result of old.
    scale = values.pop("scale", None)
    return record_from(Iteration, {"kernel_scale": scale, **values}, CHECKS)


def _of(kind: type | tuple[type, ...], value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"cannot use {value!r:.60}")
    return value


def _pose(rows: Any) -> FloatArray:
    T = float_array(rows, (4, 4))
    if not np.isnan(T).all():
        # Looked at, but kept as it was: to the last bit.
        as_pose(T, "T_target_source", RIGID_TOLERANCE)
    return T


def _finite(rows: Any) -> FloatArray:
    matrix = float_array(rows, (6, 6))
    require_finite(matrix, "partial_information")
    return matrix


def float_array(rows: Any, shape: tuple[int, ...]) -> FloatArray:
    """Rows of a file as an array of that shape, None as NaN; `ValueError` where they have another one."""
    array = np.array(rows, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"an array of shape {array.shape} instead of {shape}")
    return array


# Fields that plain types do not tell enough about.
CHECKS = {
    "T_target_source": _pose,
    "verdict": read_verdict,
    "observability": lambda directions: tuple(_direction(direction) for direction in _of(list, directions)),
    "covariance": lambda rows: float_array(rows, (6, 6)),
    "partial_information": lambda rows: None if rows is None else _finite(rows),
    "settings": lambda values: _settings(_of(dict, values)),
    "history": lambda records: tuple(_iteration(record) for record in _of(list, records)),
    # Infinite where an extrapolation was taken back.
    "motion": lambda value: np.inf if value is None else _of((int, float), value),
}
