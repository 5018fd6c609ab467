"""What a truth file says of a part: its true poses, and its symmetries."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_pose
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.files.poses import POSE, read_pose


@dataclasses.dataclass(frozen=True, eq=False)
class TruePoses:
    """What a truth file says."""

    # (k, 4, 4): True poses ``T_target_source``, the one named in the file first, then the symmetric ones
    poses: FloatArray
    axis: FloatArray | None = None  # (2, 3): Point and direction of an axis of revolution, target frame
    units: str | None = None  # Unit of the target's lengths, where the file names it


def read_truth(path: str | os.PathLike[str]) -> TruePoses:
    """TruePoses of a ``truth.json``, or of any other file that holds a pose.

    Besides ``T_target_source``, JSON may hold ``symmetric_truths``, a list of all 4x4 poses that are true because the
    part is symmetric, and ``symmetry_axis``, the ``point`` and ``direction`` of an axis of revolution (target frame).
    """
    path = Path(path)
    first = as_pose(read_pose(path), f"{path}: {POSE}")
    if path.suffix.lower() != ".json":
        return TruePoses(first[None])
    data = read_json(path, "true poses")
    return truth_of(data, first, str(path))


def truth_of(data: Any, first: FloatArray, name: str) -> TruePoses:
    """TruePoses with the symmetries that a mapping names."""
    others = data.get("symmetric_truths") or []
    if not isinstance(others, list):
        raise InputError(f"{name}: symmetric_truths must be a list of 4x4 poses; got {type(others).__name__}")
    checked = [as_pose(item, f"{name}: symmetric_truths[{i}]") for i, item in enumerate(others)]
    poses = [first, *(T for T in checked if not np.array_equal(T, first))]
    axis, named = data.get("symmetry_axis"), data.get("units")
    unit = named if isinstance(named, str) else None
    if axis is None:
        return TruePoses(np.stack(poses), units=unit)
    if not isinstance(axis, dict) or not {"point", "direction"} <= set(axis):
        raise InputError(f"{name}: symmetry_axis must have the keys point and direction; got {axis!r:.80}")
    rows = as_float([axis["point"], axis["direction"]], f"{name}: symmetry_axis")
    if rows.shape != (2, 3) or not np.linalg.norm(rows[1]) > 0.0:
        raise InputError(
            f"{name}: symmetry_axis must hold a point and a direction that is not zero, three numbers each"
        )
    return TruePoses(np.stack(poses), rows, unit)
