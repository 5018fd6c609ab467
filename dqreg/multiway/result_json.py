"""A multiway result as JSON: fields to plain values and back, every value of a file checked."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import RIGID_TOLERANCE, as_pose
from dqreg.files.strict_json import plain, record_from
from dqreg.multiway.pose_graph.edges import TEXT_OF_CODE, Edge
from dqreg.registration.result import result_json
from dqreg.registration.result.result import Registration
from dqreg.registration.result.result_json import float_array

FORMAT = "dqreg multiway 1"
CONVENTIONS = {
    "T_world_scan": "p_world = T_world_scan (p_scan, 1); row by row",
    "covariances": "rotation vector x, y, z, then translation x, y, z: of a left increment in the world frame about "
    "centre; joint: those of all scans, one after the other",
}
# Scans up to which the joint covariance is written whole; beyond, each pose's own.
MAX_SCANS_OF_JOINT_COVARIANCE = 100


def to_plain(result: Any) -> dict[str, Any]:
    """Plain values of a `Multiway` under its attribute names."""
    names = [field.name for field in dataclasses.fields(result) if field.name not in ("views", "edges", "joint")]
    values = {name: plain(getattr(result, name)) for name in names}
    values["verdict"] = {**plain(result.verdict), "codes": list(result.verdict.codes)}
    values["covariances"] = plain(result.covariances)
    values["joint"] = plain(result.joint) if len(result.names) <= MAX_SCANS_OF_JOINT_COVARIANCE else None
    values["edges"] = [
        {
            **{name: plain(getattr(edge, name)) for name in ("target", "source", "used", "code", "chi2", "overlap")},
            "registration": edge.registration.to_dict(),
        }
        for edge in result.edges
    ]
    told = {"units": result.settings.get("units"), "angle_units": result_json.ANGLE_UNITS, "conventions": CONVENTIONS}
    return {"format": FORMAT, **told, **values}


def as_text(result: Any) -> str:
    """The file of a `Multiway`."""
    return result_json.text_of(to_plain(result))


def read_fields(path: str | Path, loop: type) -> dict[str, Any]:
    """Fields of a `Multiway` from a file; the class of its loop errors is given."""
    wanted = "dqreg multiway --out result.json or Multiway.save"
    return result_json.read_saved(path, FORMAT, "dqreg multiway result", wanted, lambda values: _fields(values, loop))


def _fields(values: dict[str, Any], loop: type) -> dict[str, Any]:
    names = tuple(str(name) for name in _listed(values["names"]))
    n = len(names)
    poses = float_array(values["T_world_scan"], (n, 4, 4))
    for T in poses[np.isfinite(poses).all(axis=(1, 2))]:
        as_pose(T, "T_world_scan", RIGID_TOLERANCE)
    joint = values["joint"]
    if joint is None:
        joint = np.full((6 * n, 6 * n), np.nan)
        for k, block in enumerate(float_array(values["covariances"], (n, 6, 6))):
            joint[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
    return {
        "T_world_scan": poses,
        "verdict": result_json.read_verdict(values["verdict"]),
        "edges": tuple(_edge(each, n) for each in _listed(values["edges"])),
        "loop_errors": tuple(record_from(loop, each) for each in _listed(values["loop_errors"])),
        "overlap": float_array(values["overlap"], (n, n)),
        "centre": float_array(values["centre"], (3,)),
        "joint": float_array(joint, (6 * n, 6 * n)),
        "names": names,
        "settings": _object(values["settings"]),
        "timings": {str(name): float(number) for name, number in _object(values["timings"]).items()},
    }


def _edge(values: Any, count: int) -> Edge:
    record = dict(_object(values))
    found = _object(record.pop("registration"))
    checked = result_json.registration_fields(found, Registration)
    target, source = int(record["target"]), int(record["source"])
    if not (-1 <= target < count and 0 <= source < count) or record["code"] not in TEXT_OF_CODE:
        raise ValueError(f"an edge {target} - {source} with the code {record['code']!r:.40}")
    numbers = {name: np.nan if record[name] is None else float(record[name]) for name in ("chi2", "overlap")}
    return Edge(target, source, Registration(**checked), bool(record["used"]), record["code"], **numbers)


def _object(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f"expected an object, got {value!r:.60}")
    return value


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {value!r:.60}")
    return value
